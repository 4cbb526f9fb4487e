// Files as trackers, spreadsheets and robot pendants write them.

#include <gmock/gmock.h>

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "base/csv.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements.hpp"
#include "kdl_calibration/robot.hpp"
#include "refusal.hpp"
#include "same_measurements.hpp"
#include "support.hpp"

namespace kdl_calibration::files_as_they_come_test {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

enum class Arm { two_joints, fanuc, kuka, ur };

Measurements read(Arm arm, const std::string& text) {
  static const std::string urdf = std::string(URDF_DIR) + "/fanuc_r2000ic_165f";
  static const Robot fanuc = load_robot(urdf + ".urdf");
  static const JointConvention pendant = read_joint_convention(urdf + "_pendant.json");
  static const JointConvention kuka = parse_joint_convention(
      R"~({"controller_joints": ["A1", "A2"], "urdf_joints": ["joint_a1", "joint_a2"], "matrix": [[-1, 0], [0, 1]]})~");
  if (arm == Arm::fanuc) return parse_measurements(fanuc, text, &pendant, "m.csv");
  if (arm == Arm::kuka) return parse_measurements(text, kuka.urdf_joints, &kuka, "m.csv");
  if (arm == Arm::ur) return parse_measurements(text, {"shoulder_pan_joint", "elbow_joint"}, nullptr, "m.csv");
  return parse_measurements(text, {"joint_1", "joint_2"}, nullptr, "m.csv");
}

struct File {
  std::string from;
  Arm arm;
  std::string text;
  std::string canonical;  // the same as it would be written here
  std::string remark;     // behind "read with "; empty: none at all
};

const std::string kMm = "configuration,target,joint_1[deg],joint_2[deg],x[mm],y[mm],z[mm]\n";
const std::string kMetres = "configuration,target,joint_1,joint_2,x,y,z\n";
const std::string kTwoRows = kMm + "1,SMR1,10.5,-20,1234.5678,-9.1,5\n1,SMR2,10.5,-20,1200,8,7.25\n";
const std::string kUr = "configuration,target,shoulder_pan_joint,elbow_joint,x,y,z,qw,qx,qy,qz\n";
const std::string kFanuc = "configuration,target,J1[deg],J2[deg],J3[deg],J4[deg],J5[deg],J6[deg],x[mm],y[mm],z[mm]";
const std::string kHalf = "0.7071067811865476";
const std::string kQuarterTurn = "1.5707963267948966";

std::vector<File> trackers() {
  const std::string xyz = R"~("X [mm]" as x in mm, "Y [mm]" as y in mm, "Z [mm]" as z in mm)~";
  const std::string names = R"~("Config" as configuration, "Name" as target, )~";
  return {
      {"semicolons", Arm::two_joints,
       "Config;Name;joint_1 [deg];joint_2 [deg];X [mm];Y [mm];Z [mm]\n1;SMR1;10.5;-20;1234.5678;-9.1;5\n"
       "1;SMR2;10.5;-20;1200;8;7.25\n",
       kTwoRows, names + xyz},
      {"tabs, quotes, CRLF", Arm::two_joints,
       "\"Config\"\t\"Name\"\tjoint_1 [deg]\tjoint_2 [deg]\tX [mm]\tY [mm]\tZ [mm]\r\n"
       "1\t\"SMR1\"\t10.5\t-20\t1234.5678\t-9.1\t5\r\n1\t\"SMR2\"\t10.5\t-20\t1200\t8\t7.25\r\n",
       kTwoRows, "tabs, " + names + xyz},
      {"tabs, optional cells empty, a quoted name", Arm::two_joints,
       "configuration\tsplit\trepeat\ttarget\tjoint_1\tjoint_2\tx\ty\tz\tsigma\nc\t\t\t\"a, b\"\t1\t2\t3\t4\t5\t\n",
       kMetres + "c,\"a, b\",1,2,3,4,5\n", "tabs"},
      {"notes above, units in parentheses", Arm::two_joints,
       "# exported from the tracker, 2024-03-01\n\nconfiguration,point,joint_1 (deg),joint_2(DEG),x (mm),y(mm),z(mm)\n"
       "1,SMR1,10.5,-20,1234.5678,-9.1,5\n1,SMR2,10.5,-20,1200,8,7.25\n",
       kTwoRows,
       R"~("point" as target, "joint_1 (deg)" as joint_1 in deg, "joint_2(DEG)" as joint_2 in deg, )~"
       R"~("x (mm)" as x in mm, "y(mm)" as y in mm, "z(mm)" as z in mm)~"},
      {"a row of units, sigmas and repeats", Arm::two_joints,
       "Pose,Repeat,Point,joint_1,joint_2,X,Y,Z,Sigma\n,-,,deg,deg,mm,mm,mm,mm\n7,2,T1,1,2,1000,0,-250,0.02\n",
       "configuration,repeat,target,joint_1[deg],joint_2[deg],x[mm],y[mm],z[mm],sigma[mm]\n7,2,T1,1,2,1000,0,-250,"
       "0.02\n",
       R"~(units in line 2, "Pose" as configuration, "Repeat" as repeat, "Point" as target, "X" as x in mm, )~"
       R"~("Y" as y in mm, "Z" as z in mm, "Sigma" as sigma in mm)~"},
      {"metres in capitals", Arm::two_joints, "CONFIGURATION,TARGET,joint_1,joint_2,X[M],Y[M],Z[M]\nc,A,1,2,3,4,5\n",
       "configuration,target,joint_1,joint_2,x[m],y[m],z[m]\nc,A,1,2,3,4,5\n",
       R"~("CONFIGURATION" as configuration, "TARGET" as target, "X[M]" as x in m, "Y[M]" as y in m, "Z[M]" as z in m)~"},
      {"quaternions in capitals, one point", Arm::two_joints,
       "configuration,target,joint_1,joint_2,x,y,z,QW,QX,QY,QZ\nc,A,1,2,3,4,5,0,1,0,0\nc,B,1,2,3,4,5,,,,\n",
       "configuration,target,joint_1,joint_2,x,y,z,qw,qx,qy,qz\nc,A,1,2,3,4,5,0,1,0,0\nc,B,1,2,3,4,5,,,,\n",
       R"~("QW" as qw, "QX" as qx, "QY" as qy, "QZ" as qz)~"},
  };
}

std::vector<File> spreadsheets() {
  const std::string bom = "\xef\xbb\xbf";
  const std::string header = "configuration;target;joint_1[deg];joint_2[deg];x[mm];y[mm];z[mm]";
  return {
      {"as they were read before", Arm::two_joints,
       bom + header + ";;\r\n1;SMR1;10.5;-20;1234.5678;-9.1;5;;\r\n;;;;;;;;\r\n1;SMR2;10.5;-20;1200;8;7.25;;\r\n",
       kTwoRows, ""},
      {"German, byte order mark, CRLF, empty columns and rows", Arm::two_joints,
       bom + header + ";;\r\n1;SMR1;10,5;-20;1234,5678;-9,1;5;;\r\n;;;;;;;;\r\n1;SMR2;10,5;-20;1200;8;7,25;;\r\n",
       kTwoRows, "decimal commas"},
      {"pasted with tabs", Arm::two_joints,
       "configuration\ttarget\tjoint_1\tjoint_2\tx\ty\tz\nc\tA\t0,5\t-,25\t+1,5\t1,5E-03\t7,\n",
       kMetres + "c,A,0.5,-0.25,1.5,0.0015,7\n", "tabs, decimal commas"},
      {"quoted numbers", Arm::two_joints, header + "\n\"1\";\"SMR;1\";\"0,5\";\"1\";\"2\";\"3\";\"4,25\"\n",
       kMm + "1,\"SMR;1\",0.5,1,2,3,4.25\n", "decimal commas"},
      {"integers alone", Arm::two_joints, header + "\n1;A;1;2;3;4;5\n2;A;4;5;6;7;8\n",
       kMm + "1,A,1,2,3,4,5\n2,A,4,5,6,7,8\n", ""},
      {"German, a row of units with degree signs", Arm::two_joints,
       bom + "config;name;joint_1;joint_2;x;y;z;;\r\n-;;[\xc2\xb0];\xc2\xb0;[mm];(mm);mm;;\r\n"
             "1;SMR1;10,5;-20;1234,5678;-9,1;5;;\r\n1;SMR2;10,5;-20;1200;8;7,25;;\r\n",
       kTwoRows, R"~(decimal commas, units in line 2, "config" as configuration, "name" as target)~"},
      {"units that header and row agree on", Arm::two_joints,
       header + "\n;;degrees;deg;mm;MM;[ mm ]\n1;SMR1;10.5;-20;1234.5678;-9.1;5\n1;SMR2;10.5;-20;1200;8;7.25\n",
       kTwoRows, "units in line 2"},
      {"a row of units below an empty one", Arm::two_joints,
       "configuration,target,joint_1,joint_2,x,y,z\n,,,,,,\n# units\n,,deg,rad,mm,m,-\nc,A,90,2,3,4,5\n",
       "configuration,target,joint_1[deg],joint_2[rad],x[mm],y[m],z\nc,A,90,2,3,4,5\n", "units in line 4"},
      {"degree signs in the header, also that of Windows", Arm::two_joints,
       "configuration;target;joint_1 [\xc2\xb0];joint_2[\xb0];x;y;z\nc;A;90;-45;1;2;3\n",
       "configuration,target,joint_1[deg],joint_2[deg],x,y,z\nc,A,90,-45,1,2,3\n",
       "\"joint_1 [\xc2\xb0]\" as joint_1 in deg, \"joint_2[\\xb0]\" as joint_2 in deg"},
      {"joints and torques in another case", Arm::two_joints,
       "configuration,target,Joint_1 (degrees),JOINT_2,x,y,z,Tau_Joint_2 [NM]\nc,A,90,-1,1,2,3,55\n",
       "configuration,target,joint_1[deg],joint_2,x,y,z,tau_joint_2[Nm]\nc,A,90,-1,1,2,3,55\n",
       R"~("Joint_1 (degrees)" as joint_1 in deg, "JOINT_2" as joint_2, "Tau_Joint_2 [NM]" as tau_joint_2 in Nm)~"},
  };
}

std::vector<File> pendants() {
  const std::string fanuc_joints = R"~("j1" as J1 in deg, "X" as x in mm, "Y" as y in mm, "Z" as z in mm)~";
  return {
      {"FANUC", Arm::fanuc,
       "configuration,target,J1[deg],J2[deg],J3[deg],J4[deg],J5[deg],J6[deg],x[mm],y[mm],z[mm],W[deg],P[deg],R[deg]"
       "\n"
       "1,T,1,-2,3,-4,5,-6,1500,20,900,90,0,90\n2,T,1,-2,3,-4,5,-7,1500,20,900,0,90,90\n",
       kFanuc + ",qw,qx,qy,qz\n1,T,1,-2,3,-4,5,-6,1500,20,900,.5,.5,.5,.5\n2,T,1,-2,3,-4,5,-7,1500,20,900,.5,-.5,."
                "5,.5\n",
       "orientations from W, P, R as fixed-xyz"},
      {"FANUC, a row of units", Arm::fanuc,
       "configuration\ttarget\tj1\tJ2\tJ3\tJ4\tJ5\tJ6\tX\tY\tZ\tW\tP\tR\n\t\tdeg\tdeg\tdeg\tdeg\tdeg\tdeg\tmm\tmm\t"
       "mm\t"
       "deg\tdeg\tdeg\n1\tT\t1\t-2\t3\t-4\t5\t-6\t1500\t20\t900\t180\t0\t0\n1\tS\t1\t-2\t3\t-4\t5\t-"
       "6\t1500\t0\t0\t\t\t\n",
       kFanuc + ",qw,qx,qy,qz\n1,T,1,-2,3,-4,5,-6,1500,20,900,0,1,0,0\n1,S,1,-2,3,-4,5,-6,1500,0,0,,,,\n",
       "tabs, units in line 2, " + fanuc_joints + ", orientations from W, P, R as fixed-xyz"},
      {"FANUC, joints alone", Arm::fanuc,
       "pose;target;J1 [\xc2\xb0];J2 [\xc2\xb0];J3 [\xc2\xb0];J4 [\xc2\xb0];J5 [\xc2\xb0];J6 "
       "[\xc2\xb0];x[mm];y[mm];"
       "z[mm]\n1;T;1,5;-2;3;-4;5;-6;1500;20;900\n",
       kFanuc + "\n1,T,1.5,-2,3,-4,5,-6,1500,20,900\n",
       "decimal commas, \"pose\" as configuration, \"J1 [\xc2\xb0]\" as J1 in deg, \"J2 [\xc2\xb0]\" as J2 in deg, "
       "\"J3 [\xc2\xb0]\" as J3 in deg, \"J4 [\xc2\xb0]\" as J4 in deg, \"J5 [\xc2\xb0]\" as J5 in deg, "
       "\"J6 [\xc2\xb0]\" as J6 in deg"},
      {"KUKA", Arm::kuka,
       "configuration;target;A1 [deg];A2 [deg];x[mm];y[mm];z[mm];A[deg];B[deg];C[deg]\n"
       "1;T;1,5;-2;1500;20;900;90;0;90\n2;T;1,5;-3;1500;20;900;90;90;0\n3;T;1,5;-4;1500;20;900;0;-90;0\n",
       "configuration,target,A1[deg],A2[deg],x[mm],y[mm],z[mm],qw,qx,qy,qz\n1,T,1.5,-2,1500,20,900,.5,.5,.5,.5\n"
       "2,T,1.5,-3,1500,20,900,.5,-.5,.5,.5\n3,T,1.5,-4,1500,20,900," +
           kHalf + ",0,-" + kHalf + ",0\n",
       "decimal commas, orientations from A, B, C as moving-zyx"},
      {"KUKA in radians, small letters", Arm::kuka,
       "configuration,target,a1,a2,x,y,z,a[rad],b[rad],c[rad]\n1,T,1,2,3,4,5," + kQuarterTurn + ",0,0\n",
       "configuration,target,A1,A2,x,y,z,qw,qx,qy,qz\n1,T,1,2,3,4,5," + kHalf + ",0,0," + kHalf + "\n",
       R"~("a1" as A1, "a2" as A2, "a[rad]" as A in rad, "b[rad]" as B in rad, "c[rad]" as C in rad, )~"
       "orientations from A, B, C as moving-zyx"},
      {"UR", Arm::ur,
       "configuration,target,shoulder_pan_joint,elbow_joint,x,y,z,rx,ry,rz\n"
       "1,tcp,0.5,-1,0.3,0.4,0.5,0,0,-" +
           kQuarterTurn +
           "\n2,tcp,0.6,-1,0.3,0.4,0.5,1.2091995761561452,1.2091995761561452,1.2091995761561452\n"
           "3,tcp,0.7,-1,0.3,0.4,0.5,0,0,0\n4,tcp,0.8,-1,0.3,0.4,0.5,0,3.141592653589793,0\n",
       kUr + "1,tcp,0.5,-1,0.3,0.4,0.5," + kHalf + ",0,0,-" + kHalf +
           "\n2,tcp,0.6,-1,0.3,0.4,0.5,.5,.5,.5,.5\n3,tcp,0.7,-1,0.3,0.4,0.5,1,0,0,0\n"
           "4,tcp,0.8,-1,0.3,0.4,0.5,0,0,1,0\n",
       "orientations from rx, ry, rz as rotation-vector"},
      {"UR in degrees", Arm::ur,
       "configuration,target,shoulder_pan_joint,elbow_joint,x,y,z,RX[deg],ry[deg],rz[deg]\n1,A,1,2,3,4,5,90,0,0\n",
       kUr + "1,A,1,2,3,4,5," + kHalf + "," + kHalf + ",0,0\n",
       R"~("RX[deg]" as rx in deg, orientations from rx, ry, rz as rotation-vector)~"},
      {"angles about fixed axes as a URDF's, first x", Arm::ur,
       "configuration,target,shoulder_pan_joint,elbow_joint,x,y,z,Roll,pitch,yaw\n1,A,1,2,3,4,5," + kQuarterTurn +
           ",0," + kQuarterTurn + "\n2,A,1,3,3,4,5,0," + kQuarterTurn + "," + kQuarterTurn + "\n",
       kUr + "1,A,1,2,3,4,5,.5,.5,.5,.5\n2,A,1,3,3,4,5,.5,-.5,.5,.5\n",
       R"~("Roll" as roll, orientations from roll, pitch, yaw as fixed-xyz)~"},
      {"the same with a row of units", Arm::ur,
       "configuration,target,shoulder_pan_joint,elbow_joint,x,y,z,roll,pitch,yaw\n,,,,m,m,m,deg,deg,deg\n"
       "1,A,1,2,3,4,5,90,0,90\n1,B,1,2,3,4,5,,,\n",
       kUr + "1,A,1,2,3,4,5,.5,.5,.5,.5\n1,B,1,2,3,4,5,,,,\n",
       "units in line 2, orientations from roll, pitch, yaw as fixed-xyz"},
  };
}

void expect_read(const std::vector<File>& files) {
  for (const File& file : files) {
    SCOPED_TRACE(file.from + "\n" + file.text);
    const Measurements canonical = read(file.arm, file.canonical);
    EXPECT_THAT(canonical.remark, IsEmpty());
    const Measurements as_it_came = read(file.arm, file.text);
    testing::expect_same(as_it_came, canonical, false);
    EXPECT_EQ(as_it_came.remark, file.remark.empty() ? "" : "read with " + file.remark);
    if (file.arm == Arm::two_joints || file.arm == Arm::ur) {
      testing::expect_same(read(file.arm, measurements_csv(as_it_came)), canonical, false);
    }
  }
}

TEST(FilesAsTheyCome, OfTrackersAreReadAsTheirCanonicalForm) { expect_read(trackers()); }
TEST(FilesAsTheyCome, OfSpreadsheetsAreReadAsTheirCanonicalForm) { expect_read(spreadsheets()); }
TEST(FilesAsTheyCome, OfPendantsAreReadAsTheirCanonicalForm) { expect_read(pendants()); }

TEST(FilesAsTheyCome, AreRefusedWithTheCureWhereTheyMayMeanTwoThings) {
  struct Refused {
    std::string text;
    std::string message;  // its beginning
    Arm arm = Arm::two_joints;
  };
  const std::string header = "configuration;target;joint_1;joint_2;x;y;z";
  const std::string commas = "configuration,target,joint_1,joint_2,x,y,z";
  const std::string kuka = "configuration,target,A1,A2,x,y,z,";
  const std::string fanuc = "configuration,target,J1[deg],J2[deg],J3[deg],J4[deg],J5[deg],J6[deg],x,y,z,";
  const std::vector<Refused> all = {
      // Decimal commas.
      {header + "\n1;A;1;2;3;4;5,5\n1;B;1;2;3.5;4;5\n",
       "m.csv:3: x '3.5' has a decimal point, but numbers have decimal commas since line 2: expected one of them in "
       "all"},
      {header + "\n1;A;1;2;3;4;5\n2;B;1.5;2;3,5;4;5\n",
       "m.csv:3: x '3,5' has a decimal comma, but numbers have decimal points since line 3: expected one of them in "
       "all"},
      {header + "\n1;A;1;2;1.234,5;4;5\n",
       "m.csv:2: x '1.234,5' has more than a decimal comma: expected a number without separators of thousands"},
      {header + "\n1;A;1;2;1,234.5;4;5\n", "m.csv:2: x '1,234.5' has more than a decimal comma: expected a number w"},
      {header + "\n1;A;1;2;1,234,567;4;5\n", "m.csv:2: x '1,234,567' has more than a decimal comma: expected a n"},
      {header + "\n1;A;1;2;1,5e;4;5\n", "m.csv:2: x '1,5e' is not a number"},
      {header + "\n1;A;1;2;1,5e999;4;5\n", "m.csv:2: x '1,5e999' is outside the range of a double"},
      {header + "\n1;A;1;2;1,5e13;4;5\n", "m.csv:2: x '1,5e13' is out of range: expected at most 1e12"},
      {header + ";repeat\n1;A;1;2;3;4;5;1,0\n", "m.csv:2: repeat '1,0' is no repeat: expected an integer"},
      {commas + "\n1,A,1,2,\"3,5\",4,5\n",
       "m.csv:2: x '3,5' has a decimal comma: expected a number with a decimal point, or semicolons between the "
       "columns"},
      {commas + "\n1,A,1,2,\"1.234,5\",4,5\n", "m.csv:2: x '1.234,5' has a decimal comma: expected a number with a"},
      // Tabs.
      {"configuration\ttarget\tjoint_1\tjoint_2\tx\ty\tz\n1\t\"A\tB\"\t1\t2\t3\t4\t5\n",
       "m.csv:2: target 'A\\x09B' has a control character"},
      {"configuration\ttarget\tjoint_1\tjoint_2\tx\ty\tz\n1\t\"A\"B\t1\t2\t3\t4\t5\n", "m.csv:2: text after the"},
      // Columns.
      {"name;" + header + "\n", "m.csv:1: column 'target' repeats 'name'"},
      {header + ";X [mm]\n", "m.csv:1: column 'X [mm]' repeats 'x'"},
      {header + ";Joint_1\n", "m.csv:1: column 'Joint_1' repeats 'joint_1'"},
      {header + ";config\n", "m.csv:1: column 'config' repeats 'configuration'"},
      {"configuration,target,J1(deg),J2(deg),x,y,z\n",
       "m.csv:1: unknown column 'J1(deg)' (controller's joint names need --joint-convention): expected configuration"},
      {"configuration,target,joint_1(grad),joint_2,x,y,z\n",
       "m.csv:1: unknown unit 'grad' in column 'joint_1(grad)': expected [rad], [deg], [m], [mm]"},
      // Units in a row.
      {"configuration,target,joint_1[rad],joint_2,x,y,z\n,,deg,,,,\n",
       "m.csv:2: unit 'deg' contradicts column 'joint_1[rad]': expected one unit in header and row of units"},
      {commas + "\n,mm,deg,deg,m,m,m\n", "m.csv:2: unknown unit 'mm' in column 'target': expected none"},
      {commas + "\n,,,,deg,,\n", "m.csv:2: unknown unit 'deg' in column 'x': expected [m], [mm]"},
      {commas + "\n,,deg,deg,mm,mm\n", "m.csv:2: 6 fields, expected 7 as in the header in line 1"},
      {commas + ",\n,,deg,deg,mm,mm,mm,mm\n", "m.csv:2: value 'mm' in a column without a name"},
      {commas + "\n-,-,-,-,-,-,-\n", "m.csv:2: joint_1 '-' is not a number"},
      {commas + "\n,,deg,deg,mm,mm,mm\n", "m.csv: no rows after the header in line 1"},
      {fanuc + "W,P,R\n,,mm,,,,,,,,,,,\n", "m.csv:2: unknown unit 'mm' in column 'J1[deg]': expected [rad], [deg]",
       Arm::fanuc},
      // Orientations.
      {kuka + "A,B[deg],C\n", "m.csv:1: no unit of A, C: write A[deg], C[deg] as on pendants of KUKA (or [rad])",
       Arm::kuka},
      {fanuc + "W,P,R\n1,T,1,2,3,4,5,6,1,2,3,0,0,90\n",
       "m.csv:1: no unit of W, P, R: write W[deg], P[deg], R[deg] as on pendants of FANUC (or [rad])", Arm::fanuc},
      {kuka + "A[deg],B[deg]\n", "m.csv:1: missing column C: expected configuration", Arm::kuka},
      {commas + ",rx,rz\n", "m.csv:1: missing column ry: expected configuration"},
      {commas + ",qw,qx,qy,qz,W[deg]\n",
       "m.csv:1: columns 'qw' and 'W[deg]' state orientations in two forms: expected either qw, qx, qy, qz or W, P, R"},
      {commas + ",Yaw,RX,roll\n",
       "m.csv:1: columns 'RX' and 'roll' state orientations in two forms: expected either rx, ry, rz or roll, pitch, "
       "yaw"},
      {commas + ",rx,ry,rz\nc,A,1,2,3,4,5,0,,0\n",
       "m.csv:2: the orientation has an empty cell: expected all of rx, ry, rz or none"},
      {commas + ",roll,pitch,yaw\nc,A,1,2,3,4,5,,,0\n",
       "m.csv:2: the orientation has an empty cell: expected all of roll, pitch, yaw or none"},
      {commas + ",RX,ry,rz\nc,A,1,2,3,4,5,0,0,0\nc,B,1,2,3,4,5,-90,0,0\n",
       "m.csv:3: RX '-90' without a unit is no angle in radians: degrees? write RX[deg] (or [rad])"},
      {commas + ",roll,pitch,yaw\nc,A,1,2,3,4,5,0,0,6.29\n",
       "m.csv:2: yaw '6.29' without a unit is no angle in radians: degrees? write yaw[deg] (or [rad])"},
      {commas + ",rx[mm],ry,rz\n", "m.csv:1: unknown unit 'mm' in column 'rx[mm]': expected [rad], [deg]"},
  };
  for (const Refused& file : all) {
    EXPECT_REFUSED_WITH(StartsWith(file.message), read(file.arm, file.text)) << file.text;
  }
}

TEST(FilesAsTheyCome, KeepAnglesOfATurnAndStatedRadiansBeyondIt) {
  const std::string header = "configuration,target,joint_1,joint_2,x,y,z,roll,pitch";
  EXPECT_NEAR(
      testing::orientation_of(read(Arm::two_joints, header + ",yaw\nc,A,1,2,3,4,5,0,0,-6.2832\n").observations[0]).z(),
      0.0, 1e-5);
  EXPECT_NEAR(std::abs(testing::orientation_of(
                           read(Arm::two_joints, header + ",yaw[rad]\nc,A,1,2,3,4,5,0,0,7\n").observations[0])
                           .z()),
              -std::sin(3.5), 1e-15);
}

TEST(FilesAsTheyCome, NameJointsBeforeAnythingElse) {
  const auto values = [](const std::vector<std::string>& joints, const std::string& columns) {
    return parse_measurements("configuration,target,x,y,z," + columns + "\nc,T,1,2,3,4,5\n", joints).joint_values;
  };
  for (const std::vector<std::string>& joints : std::vector<std::vector<std::string>>{
           {"A", "B"}, {"X", "name"}, {"rx", "pose"}, {"a(deg)", "Target"}, {"j", "J"}, {"W", "w"}}) {
    EXPECT_EQ(values(joints, joints[1] + "," + joints[0]), Eigen::Vector2d(5, 4)) << joints[0];
    const Measurements m = parse_measurements(
        "configuration,target," + joints[0] + "," + joints[1] + ",x,y,z,qw,qx,qy,qz\nc,T,1,2,3,4,5,0,0,0,1\n", joints);
    testing::expect_same(parse_measurements(measurements_csv(m), joints), m, false);
    EXPECT_THAT(m.remark, IsEmpty());
  }
  EXPECT_REFUSED_WITH(StartsWith("measurements:1: unknown column 'AXIS'"), values({"Axis", "aXIS"}, "AXIS,axis"));
  for (const std::string name : {"x", "target", "qw", "sigma"}) {
    EXPECT_REFUSED("is named like a column", values({name, "b"}, "a,b"));
  }
}

TEST(FilesAsTheyCome, SayAllThatIsUnusualOfThemInOneLine) {
  const Measurements m = read(Arm::two_joints,
                              "config\ttarget\tjoint_1\tjoint_2\tx\ty\tz\tsigma\n1\tA\t0,5\t1\t1\t2\t3\t1\n"
                              "1\tB\t0,50004\t1\t1\t2\t3\t1\n");
  EXPECT_EQ(m.remark,
            "read with tabs, decimal commas, \"config\" as configuration; joint values of 1 configurations scatter by "
            "up to 4e-05 rad or m from row to row: their means are used");
  EXPECT_EQ(parse_configurations("J 1 [deg];j2 (DEG)\n0,5;-90\n", {"J 1", "J2"}).remark,
            "read with decimal commas, \"j2 (DEG)\" as J2 in deg");
}

TEST(FilesAsTheyCome, ThatAreWrittenRunNoFormulaAndReadBack) {
  const std::vector<std::pair<std::string, std::string>> fields = {
      {"=1+2", "'=1+2"},
      {"@A1", "'@A1"},
      {"-HYPERLINK(1)", "'-HYPERLINK(1)"},
      {"+cmd|' /C calc'!A0", "'+cmd|' /C calc'!A0"},
      {"=SUM(A1,\"x\")", "\"'=SUM(A1,\"\"x\"\")\""},
      {"'=1", "''=1"},
      {"''@", "'''@"},
      {"'-1", "''-1"},
      {"-", "'-"},
      {"-inf", "'-inf"},
      {"-1", "-1"},
      {"+2.5e-3", "+2.5e-3"},
      {"'90s", "'90s"},
      {"'", "'"},
      {"A=1", "A=1"},
  };
  for (const auto& [name, field] : fields) {
    EXPECT_EQ(csv_field(name), field);
    Measurements m = parse_measurements("configuration,target,a,b,x,y,z\nc,A,1,2,3,4,5\n", {"a", "b"});
    m.configurations[0] = m.targets[0] = m.joints[0] = name;
    for (const JointUnit unit : {JointUnit::unstated, JointUnit::radian}) {
      m.joint_units = unit == JointUnit::unstated ? std::vector<JointUnit>() : std::vector(2, unit);
      const std::string csv = measurements_csv(m);
      EXPECT_THAT(csv, HasSubstr("\n" + field + "," + field + ","));
      testing::expect_same(parse_measurements(csv, m.joints), m, false);
    }
  }
  EXPECT_EQ(parse_measurements("configuration,target,a,x,y,z\n'-1,'A,1,3,4,5\n", {"a"}).configurations[0], "-1");
}

}  // namespace
}  // namespace kdl_calibration::files_as_they_come_test
