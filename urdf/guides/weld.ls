/PROG  WELD
/MN
   1:  UFRAME_NUM=0 ;
   2:  UTOOL_NUM=0 ;
   3:J P[1] 50% FINE ;
   4:L P[2] 200mm/sec FINE ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =  1850.000  mm,	Y =   200.000  mm,	Z =   900.000  mm,
	W =   180.000 deg,	P =   -60.000 deg,	R =    10.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 0,		CONFIG : 'N U T, 0, 0, 0',
	X =  1850.000  mm,	Y =   250.000  mm,	Z =   900.000  mm,
	W =   180.000 deg,	P =   -60.000 deg,	R =    10.000 deg
};
/END
