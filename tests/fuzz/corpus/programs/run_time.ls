/PROG  B
/APPL
LINE_TRACK;
  LINE_TRACK_SCHEDULE_NUMBER      : 2;
/MN
   1:  UFRAME[1]=PR[2]    ;
   2:  IF (R[1:a]=1),UTOOL_NUM=R[3] ;
   3:  PR[9:b]=P[2]-PR[1]    ;
   4:J PAL_1[BTM] 10% CNT50 COORD    ;
   5:C P[1]
    :  P[2:"] 9mm/sec FINE PTH
    :  RTCP Skip,LBL[1: ;] INC    ; ! a
    :  Arc Start[1] ;
      1:  WKZ_NUM=R[1] ;
       ------ ;
   6:  //L P[3] 9mm/sec FINE    ;
   7:JP[AR[1]] 10% FINE VOFFSET,VR[1]    ;
/POS
P[1]{
   GP1:
	UF : 0, UT : 1,		KONFIG : 'F D B, 1, -1, 0',
	X =	1500.5	mm,	Y =     -.250  mm,	Z =      .000  mm,
	W =   180.000 deg,	P =   -90.000 deg,	R =     0.000 deg,
	E1=  -800.000  mm,	E2=    30.000 deg
};
P[2]{
   GP1:
	UF : 0, UT : 1,		CONFIG : 'N U T, 0, 0, 0',
	RX =  1500.000  mm,	RY =   100.000  mm,	RZ =   600.000  mm,
	RW =   180.000 deg,	RP =     0.000 deg,	RR =     0.000 deg
};
P[3]{
   GP1:
	UF : F, UT : F,	
	J1= ******** deg,	J2= ******** deg,	J3= ******** deg,
	J4= ******** deg,	J5= ******** deg,	J6= ******** deg,
	E1= ********  mm
};
P[4]{
   GP2:
	UF : 0, UT : 1,	
	J1=   100.000  mm
};
/END
