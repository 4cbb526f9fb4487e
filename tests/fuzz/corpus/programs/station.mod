%%%
  VERSION:1
  LANGUAGE:ENGLISH
%%%

MODULE Station(SYSMODULE,NOSTEPIN)
  ! "pens" [and] cubes
  LOCAL PERS tooldata pen:=[TRUE,[[0,0,206],[0.5,0.5,0.5,0.5]],
    [1.8,[2.7,0,84.4],[1,0,0,0],0.033,0.034,0.007]];
  TASK PERS wobjdata Table:=[FALSE,TRUE,"",[[1000,0,500],[0,0,0,1]],[[10,20,30],[1,0,0,0]]];
  PERS wobjdata turned:=[FALSE,FALSE,"STN_1",[[0,0,0],[1,0,0,0]],[[0,0,0],[1,0,0,0]]];
  CONST confdata conf:=[0,-1,0,1];
  VAR extjoint ext:=[9E9,120.5,9E9,9E9,9E9,9E9];
  CONST robtarget p10:=[[-312.23,-47.51,+51.50],[0.0710383,-0.193736,-0.955349,-0.211491],[-1,0,-4,1],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
  CONST robtarget cube{2}:=[[[24.83,308.61,1E-03],[0,0,-1,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]],
    [[-51.17,308.79,159.01],[0,0,-1,0],[1,0,0,0],[-1.5,9E+09,700,9E+09,9E+09,9E+09]]];
  RECORD weld
    robtarget place;
  ENDRECORD
  FUNC robtarget Found(robtarget start \switch fast | \num x)
    VAR robtarget found;
    ConfL\Off;
    TEST n
      CASE 1, 2: moveL P10, v100, \T:=n, fine, PEN \wobj:=table;
      DEFAULT : Stop;
    ENDTEST
    IF n < .2 n  := .2;
    IF n=1 AND NOT ready{2} MoveC p10, cube{1},
      v500\V:=20, z10, pen\WObj:=Table\TLoad:=load0;
    MoveJ RelTool(Offs(cube{n},0,0,100),0,0,5\Rz:=9),v10,z1,pen\WObj:=Table;
    MoveJ [[100,20,300],[1,0,0,0],conf,ext],v10,fine,tool0;
    MoveAbsJ [[0,-10.5,0,0,90,-30],[9E9,9E9,9E9,9E9,9E9,9E9]]\NoEOffs,vmax,fine,pen;
    SearchL\Stop,di1\PosFlank,found,p10,v1,pen\WObj:=Table;
    pen.tframe.trans.z:=5;
    TPWrite "a ""quoted"" text; "\Num:=n;
    %"Rout"+ValToStr(n)%;
    <SMT>
    next: GOTO next;
    RETURN found;
  ERROR (ERR_WHLSEARCH)
    TRYNEXT;
  ENDFUNC
ENDMODULE
