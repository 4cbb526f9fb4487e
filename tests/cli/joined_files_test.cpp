// Points in one file and joint values in another, against the same rows in one file.

#include "cli/joined_files.hpp"

#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "cli_options_support.hpp"
#include "refusal.hpp"

namespace kdl_calibration::testing::joined_files_test {
namespace {

using ::testing::HasSubstr;

// Rows of a tracker: the name, then x, y, z in millimetres.
struct Written {
  char separator = ',';
  bool decimal_commas = false;
  std::string pattern = "C{0}_{1}";
};

std::string number(double value, const Written& as) {
  std::string text = fmt::format("{:.17g}", value);
  if (as.decimal_commas) {
    std::replace(text.begin(), text.end(), '.', ',');
  }
  return text;
}

std::string points_of(const Measurements& measured, const Written& as) {
  std::string csv = fmt::format("# tracker\nx[mm]{0}Name{0}y[mm]{0}z[mm]\n", as.separator);
  for (const Observation& row : measured.observations) {
    const std::string name =
        fmt::format(fmt::runtime(as.pattern), measured.configurations[static_cast<std::size_t>(row.configuration)],
                    measured.targets[static_cast<std::size_t>(row.target)]);
    csv += fmt::format("{1}{0}{2}{0}{3}{0}{4}\n", as.separator, number(row.position().x() * 1e3, as), name,
                       number(row.position().y() * 1e3, as), number(row.position().z() * 1e3, as));
  }
  return csv;
}

std::string joints_of(const Measurements& measured) {
  std::string csv = "configuration;joint_1;joint_2;joint_3;joint_4;joint_5;joint_6\n";
  for (Eigen::Index c = measured.joint_values.cols() - 1; c >= 0; --c) {  // in another order
    csv += measured.configurations[static_cast<std::size_t>(c)];
    for (const double q : measured.joint_values.col(c)) {
      csv += ";" + number(q, {.decimal_commas = true});
    }
    csv += "\n";
  }
  return csv;
}

class JoinedFilesOfATracker : public CommandLine {
protected:
  const Measurements measured = measured_fanuc({.sigma = 2e-5}, false);

  Measurements joined(const std::string& points, const std::string& names) {
    write("p.csv", points);
    write("j.csv", joints_of(measured));
    return cli::read_joined(
        fanuc(),
        {.points = (directory / "p.csv").string(), .joint_values = (directory / "j.csv").string(), .names = names},
        nullptr);
  }
};

TEST_F(JoinedFilesOfATracker, AreTheRowsOfOneFile) {
  const std::vector<std::pair<Written, std::string>> cases = {
      {{}, "C{configuration}_{target}"},
      {{.separator = ';', .decimal_commas = true, .pattern = "{1}/{0}.pt"}, "{target}/{configuration}.pt"},
      {{.separator = '\t', .pattern = "Group::{0}:{1}"}, "Group::{configuration}:{target}"}};
  for (const auto& [as, names] : cases) {
    const Measurements found = joined(points_of(measured, as), names);
    EXPECT_EQ(found.targets, measured.targets) << names;
    EXPECT_EQ(found.configurations, measured.configurations) << names;
    EXPECT_EQ(found.joint_values, measured.joint_values) << names;  // every digit
    ASSERT_EQ(found.observations.size(), measured.observations.size());
    for (std::size_t i = 0; i < found.observations.size(); ++i) {
      EXPECT_LT((found.observations[i].position() - measured.observations[i].position()).norm(), 1e-15) << names;
      EXPECT_EQ(found.observations[i].configuration, measured.observations[i].configuration);
      EXPECT_EQ(found.observations[i].target, measured.observations[i].target);
    }
  }
}

// The columns in a comment, by their order, or as a header; millimetres or metres in a comment.
TEST_F(JoinedFilesOfATracker, ExportsOfSpatialAnalyzerAreReadAsTheyAre) {
  const std::string names = "P{configuration}_{target}";
  const std::string rows = "A, Robot, P2_A, 1646.5659, -492.2970, 1348.4551\nA, Robot, P1_B, 1, 2, 3\n";
  const std::vector<std::string> files = {
      "// SA 2019.1\n// Units: Millimeters\n\n// Collection, Group, Target, X, Y, Z\n" + rows,
      "// Units: Millimeters\n" + rows, "// made by \"SA\nCollection, Group, Point Name, X[mm], Y[mm], Z[mm]\n" + rows,
      "// Units: mm\n// a word, another\nCollection,Group,Point Name,X,Y,Z\n" + rows};
  for (const std::string& file : files) {
    const Measurements found = joined(file, names);
    ASSERT_EQ(found.observations.size(), 2U) << file;
    EXPECT_EQ(found.targets, (std::vector<std::string>{"A", "B"}));
    EXPECT_EQ(found.configurations, (std::vector<std::string>{"2", "1"}));
    EXPECT_LT((found.observations[0].position() - Eigen::Vector3d(1.6465659, -0.492297, 1.3484551)).norm(), 1e-12);
    EXPECT_THAT(found.remark, ::testing::AllOf(HasSubstr("ollection\" passed over"), HasSubstr("roup\" passed over")));
  }
  const Measurements metres = joined("// Units: Meters\nA,G,P1_A,1.5,2,3\n// the end\n", names);
  EXPECT_EQ(metres.observations[0].position(), Eigen::Vector3d(1.5, 2.0, 3.0));
  const std::vector<std::pair<std::string, std::string>> refused = {
      {"// SA\n// Units: Inches\n" + rows, "p.csv:2: unit 'Inches' is not read: expected Millimeters or Meters"},
      {"// Units: Millimeters\n\nA, Robot, base, 1, 2, 3\n", "p.csv:3: point 'base'"},
      {"// Units: Millimeters\nA, Robot, P9_A, 1, 2, 3\nA, Robot, P99_A, 1, 2, 3\n", "p.csv:3: configuration '99'"},
      {"// SA\nA, P1_A, 1, 2, 3\n", "p.csv:2: expected a column 'name'"}};
  for (const auto& [file, words] : refused) {
    EXPECT_THAT(refusal([&, &file = file] { joined(file, names); }), HasSubstr(words)) << file;
  }
}

TEST_F(JoinedFilesOfATracker, AColumnNamesTheConfigurationAsWell) {
  const Measurements found = joined("pose,point,x,y,z,sigma\n,,mm,mm,mm,mm\n2,A,1,2,3,0.5\n\n1,B,4,5,6,0.5\n", "");
  EXPECT_EQ(found.configurations, (std::vector<std::string>{"2", "1"}));
  EXPECT_EQ(found.targets, (std::vector<std::string>{"A", "B"}));
  EXPECT_EQ(found.observations[1].position(), Eigen::Vector3d(4e-3, 5e-3, 6e-3));
  EXPECT_EQ(found.observations[1].sigma, 5e-4);
  EXPECT_EQ(found.joint_values.col(1), measured.joint_values.col(0));
}

// A file of joint values for three configurations, and what else it says of them.
const std::string kMore =
    "configuration,split,anchor,order,tau_joint_2[Nm],joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,"
    "temperature_link_1\n"
    "1,train,left,7,100,0.1,0.2,0.3,0.4,0.5,0.6,20\n2,test,right,3,200,0.2,0.3,0.4,0.5,0.6,0.7,25\n";

TEST_F(JoinedFilesOfATracker, JointValuesBringWhatElseTheirFileSays) {
  write("j.csv", kMore);
  const auto read = [&](const std::string& points, const std::string& names) {
    write("p.csv", points);
    return cli::read_joined(
        fanuc(),
        {.points = (directory / "p.csv").string(), .joint_values = (directory / "j.csv").string(), .names = names},
        nullptr);
  };
  const std::vector<std::pair<std::string, std::string>> same = {
      {"name,x,y,z\nC2_A,1,2,3\nC1_A,4,5,6\n", "C{configuration}_{target}"},
      {"configuration,name,split,station,order,x,y,z\n2,A,test,right,3,1,2,3\n1,A,,,,4,5,6\n", ""},
      {"x,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,y,configuration,z,name\n"
       "1,0.2,0.3,0.4,0.5,0.6,0.7,2,2,3,A\n4,0.1,0.2,0.3,0.4,0.5,0.6,5,1,6,A\n",
       ""}};
  for (const auto& [points, names] : same) {
    const Measurements found = read(points, names);
    ASSERT_EQ(found.observations.size(), 2U) << points;
    EXPECT_EQ(found.observations[0].position(), Eigen::Vector3d(1.0, 2.0, 3.0));
    EXPECT_EQ(found.observations[0].split, Split::test);
    EXPECT_EQ(found.observations[1].split, Split::train);
    EXPECT_EQ(found.stations, (std::vector<std::string>{"right", "left"}));
    EXPECT_EQ(found.observations[0].order, 3);
    EXPECT_EQ(found.observations[1].order, 7);
    EXPECT_EQ(found.signals.torques(1, 0), 200.0);
    EXPECT_EQ(found.signals.torques(1, 1), 100.0);
    EXPECT_EQ(found.signals.links, (std::vector<std::string>{"link_1"}));
    EXPECT_EQ(found.signals.link_temperatures, Eigen::RowVector2d(25.0, 20.0));
    EXPECT_EQ(found.joint_values(5, 1), 0.6);
  }
  const std::vector<std::pair<std::string, std::string>> refused = {
      {"configuration,name,split,x,y,z\n1,A,test,1,2,3\n",
       "p.csv:2: split 'test', but " + (directory / "j.csv").string() + " has 'train' for configuration '1'"},
      {"configuration,name,station,x,y,z\n1,A,right,1,2,3\n", "p.csv:2: station 'right', but "},
      {"configuration,name,order,x,y,z\n1,A,8,1,2,3\n", "p.csv:2: order '8', but "},
      {"configuration,name,tau_joint_2[Nm],x,y,z\n1,A,100,1,2,3\n", "expected them in one of the two"},
      {"configuration,name,temperature_link_2,x,y,z\n1,A,20,1,2,3\n", "has temperatures of links, and "},
      {"configuration,name,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6,x,y,z\n1,A,0.1,0.2,0.31,0.4,0.5,0.6,1,2,3\n",
       "joint values of configuration '1' differ from those of "}};
  for (const auto& [points, words] : refused) {
    EXPECT_THAT(refusal([&, &points = points] { read(points, ""); }), HasSubstr(words)) << points;
  }
}

TEST_F(JoinedFilesOfATracker, WhatDoesNotFitIsRefusedByFileAndLine) {
  const std::string names = "C{configuration}_{target}";
  struct Case {
    std::string points;
    std::string names;
    const char* words;
  };
  const std::vector<Case> cases = {{"name,x,y,z\nC1_A,1,2,3\nbase,1,2,3\n", names, "p.csv:3: point 'base'"},
                                   {"name,x,y,z\n\nC99_A,1,2,3\n", names,
                                    "p.csv:3: configuration '99' has no joint values, expected a configuration of "},
                                   {"name,x,y,z\n\nC1_A,1,a,3\n", names, "p.csv:3"},
                                   {"name,x,y,z\nC_A,1,2,3\n", names, "p.csv:2: point 'C_A'"},
                                   {"name,x,y,z\nC1_,1,2,3\n", names, "p.csv:2: point 'C1_'"},
                                   {"x,y,z\n1,2,3\n", names, "p.csv:1: expected a column 'name'"},
                                   {"configuration,name,x,y,z\n1,C1_A,1,2,3\n", names, "no column 'configuration'"},
                                   {"name,x,y,z\nC1_A,1,2,3\n", "", "or --point-names"},
                                   {"name,x,y,z\nC1_A,1,2,3\n", "{target}", "such as C{configuration}_{target}"},
                                   {"name,x,y,z\nC1_A,1,2,3\n", "{target}{configuration}", "between the two"}};
  for (const Case& each : cases) {
    EXPECT_THAT(refusal([&] { joined(each.points, each.names); }), HasSubstr(each.words)) << each.points;
  }
  for (const char* name : {"base", "C99_A"}) {
    EXPECT_THAT(refusal([&] { joined("name,x,y,z\n" + std::string(name) + ",1,2,3\n", names); }),
                HasSubstr("expected a configuration of " + (directory / "j.csv").string() + ": 16, 15, 14, 13"));
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::joined_files_test
