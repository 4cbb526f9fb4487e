/PROG  T
/MN
   1:J P[1] 100% FINE ;
   2:C P[2]
    :  P[1] 9mm/sec FINE Offset,PR[1] ;
/POS
P[1]{
   GP1:
	UF : 0, UT : F,		CONFIG : 'N U T, 0, -1, 0',
	X =  1807.000  mm,	Y =     -.250  mm,	Z =      .000  mm,
	W =   180.000 deg,	P =   -90.000 deg,	R =     0.000 deg
};
P[2:"a"]{
   GP1:
	UF : 0, UT : 1,	
	J1=     0.000 deg,	J2=     0.000 deg,	J3=     0.000 deg,
	J4=     0.000 deg,	J5=   -90.000 deg,	J6=     0.000 deg,
	E1=   100.000  mm
   GP2:
	UF : 0, UT : 1,	
	J1=     0.000  mm
};
/END
