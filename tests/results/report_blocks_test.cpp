// The JSON that a page shows beside a result, each field against what it was made from.

#include "results/report_blocks.hpp"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "effects/effect_terms.hpp"
#include "effects/joint_effects.hpp"
#include "estimation/prediction.hpp"
#include "json_support.hpp"
#include "measurements/drive_signals.hpp"
#include "measurements/training_rows.hpp"
#include "model/kinematics.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::report_blocks_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using testing::frame_of;
using testing::vector_of;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The odd arm with a box, a cylinder and a sphere, and a mesh that is not drawn.
std::string shaped_arm() {
  std::string urdf = testing::kOddArm;
  const auto give = [&](const std::string& link, const std::string& geometry) {
    const std::string bare = "<link name=\"" + link + "\"/>";
    urdf.replace(urdf.find(bare), bare.size(),
                 "<link name=\"" + link + "\"><collision><origin xyz=\"0.1 0.2 0.3\" rpy=\"0.4 0.5 0.6\"/><geometry>" +
                     geometry + "</geometry></collision></link>");
  };
  give("a", "<box size=\"0.1 0.2 0.3\"/>");
  give("bracket", "<cylinder radius=\"0.05\" length=\"0.4\"/>");
  give("tool", "<sphere radius=\"0.07\"/>");
  give("d", "<mesh filename=\"d.stl\"/>");
  return urdf;
}

TEST(ReportBlocks, TheArmIsThatOfTheUrdf) {
  const Robot robot = parse_robot(shaped_arm());
  const ErrorModel model = complete_model(robot);
  Random random(4);
  const Estimate estimate{.errors = testing::random_errors(model, random, 0.01, 0.02),
                          .frames = {.bases = {Eigen::Isometry3d(Eigen::Translation3d(0.3, -1.0, 0.2) *
                                                                 Eigen::AngleAxisd(0.7, Vector3d::UnitY()))},
                                     .targets = testing::circle_of_targets()},
                          .effects = {}};
  const Json block = robot_block(robot, model, estimate);
  EXPECT_EQ(block["name"], "odd");
  EXPECT_EQ(block["base_link"], "world");
  EXPECT_EQ(block["tip_link"], "tool");
  EXPECT_EQ(block["joints"], Json::parse(R"([{"name": "turn", "type": "revolute", "lower": -3.0, "upper": 3.0},
      {"name": "slide", "type": "prismatic", "lower": -0.5, "upper": 0.5},
      {"name": "skew", "type": "continuous", "lower": null, "upper": null},
      {"name": "elbow", "type": "revolute", "lower": -2.0, "upper": 2.0},
      {"name": "wrist", "type": "revolute", "lower": -2.0, "upper": 2.0}])"));
  EXPECT_LT((frame_of(block["base"]).matrix() - estimate.frames.base().matrix()).norm(), 1e-15);
  ASSERT_EQ(block["targets"].size(), 3U);
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_EQ(block["targets"][k]["name"], estimate.frames.targets[k].name);
    EXPECT_EQ(vector_of(block["targets"][k]["position"]), estimate.frames.targets[k].X_FT.translation());
  }
  std::vector<std::string> links;
  int joint = 0;
  for (const Json& segment : block["segments"]) {
    links.push_back(segment["link"]);
    EXPECT_EQ(segment.contains("joint"), links.back() != "bracket" && links.back() != "tool") << links.back();
    if (segment.contains("joint")) {
      EXPECT_EQ(segment["joint"], joint);
      const Vector3d axis = to_eigen(model.joints[static_cast<std::size_t>(joint++)].axis);
      EXPECT_LT((vector_of(segment["axis"]) - axis).norm(), 1e-15);
      for (int across = 0; across < 2; ++across) {
        EXPECT_LT((vector_of(segment["across"][static_cast<std::size_t>(across)]) - z_onto(axis).col(across)).norm(),
                  1e-15);
      }
    }
  }
  EXPECT_THAT(links, ::testing::ElementsAre("a", "b", "bracket", "c", "d", "e", "tool"));
  const Eigen::Isometry3d X_LS = to_eigen(KDL::Frame(KDL::Rotation::RPY(0.4, 0.5, 0.6), KDL::Vector(0.1, 0.2, 0.3)));
  const std::vector<std::tuple<int, std::string, Vector3d>> shapes = {{1, "box", Vector3d(0.1, 0.2, 0.3)},
                                                                      {3, "cylinder", Vector3d(0.05, 0.0, 0.4)},
                                                                      {7, "sphere", Vector3d(0.07, 0.0, 0.0)}};
  ASSERT_EQ(block["shapes"].size(), shapes.size());
  for (std::size_t s = 0; s < shapes.size(); ++s) {
    const auto& [link, kind, size] = shapes[s];
    const Json& shape = block["shapes"][s];
    EXPECT_EQ(shape["link"], link);
    EXPECT_EQ(shape["kind"], kind);
    EXPECT_EQ(vector_of(shape["size"])[0], size[0]);
    EXPECT_EQ(vector_of(shape["size"])[2], size[2]);
    EXPECT_LT((frame_of(shape["frame"]).matrix() - X_LS.matrix()).norm(), 1e-15);
  }
}

TEST(ReportBlocks, AnArmOfWrongShapesHasNone) {
  std::string urdf = shaped_arm();
  urdf.replace(urdf.find("radius=\"0.07\""), 13, "radius=\"-1.0\"");
  const Robot robot = parse_robot(urdf);
  const ErrorModel model = complete_model(robot);
  const Estimate nominal{.errors = testing::errors_of(model), .frames = {}, .effects = {}};
  EXPECT_EQ(robot_block(robot, model, nominal)["shapes"], Json::array());
}

/// The odd arm with effects, of which the last configurations are test rows.
struct Measured : testing::VirtualExperiment {
  Measurements measured;
  Estimate before;

  explicit Measured(int configurations = 12)
      : VirtualExperiment({.model = complete_model(parse_robot(testing::kOddArm)),
                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(2.0, -1.0, 0.3) *
                                                     Eigen::AngleAxisd(0.8, Vector3d(0.2, 0.5, 1.0).normalized())),
                           .random = Random(6)}) {
    const MatrixXd q = VirtualExperiment::configurations(configurations);
    robot.model.effects = effect_terms(model, EffectGroup::gravity, q);
    robot.truth.effects = VectorXd::Constant(static_cast<Index>(robot.model.effects.size()), 1e-3);
    measured = measure(q, {.sigma = 1e-3, .repeats = 2});
    for (Observation& o : measured.observations) {
      o.split = o.configuration >= 9 ? Split::test : Split::train;
    }
    before = robot.truth;
    before.errors.setZero();
    before.effects.setZero();
  }

  Json block(bool with_before = true) const {
    return measurements_block({.model = robot.model,
                               .estimate = robot.truth,
                               .measurements = measured,
                               .before = with_before ? &before : nullptr});
  }

  Vector3d residual(const Estimate& estimate, std::size_t row) const {
    const Observation& o = measured.observations[row];
    return o.position() - predicted_point(estimate, flange_poses(robot.model, estimate, measured), o);
  }
};

TEST(ReportBlocks, EveryRowHasItsPointAndResiduals) {
  const Measured m;
  const Json block = m.block();
  EXPECT_EQ(block["targets"], Json(m.measured.targets));
  EXPECT_EQ(block["rows"], 72);
  EXPECT_EQ(block["all_configurations"], 12);
  EXPECT_EQ(block["complete"], true);
  ASSERT_EQ(block["points"].size(), 72U);
  for (std::size_t row = 0; row < 72; ++row) {
    const Observation& o = m.measured.observations[row];
    const Json& point = block["points"][row];
    EXPECT_EQ(point["row"], row);
    EXPECT_EQ(block["configurations"][point["configuration"].get<std::size_t>()]["name"],
              m.measured.configurations[static_cast<std::size_t>(o.configuration)]);
    EXPECT_EQ(point["target"], o.target);
    EXPECT_EQ(point["repeat"], o.repeat);
    EXPECT_EQ(point["test"], o.configuration >= 9);
    EXPECT_EQ(vector_of(point["measured"]), o.position());
    EXPECT_LT((vector_of(point["residual"]) - m.residual(m.robot.truth, row)).norm(), 1e-14);
    EXPECT_LT((vector_of(point["before"]) - m.residual(m.before, row)).norm(), 1e-14);
  }
  ASSERT_EQ(block["configurations"].size(), 12U);
  const MatrixXd effective = effective_joint_values(m.robot.model, m.robot.truth.effects, m.measured.joint_values);
  for (std::size_t c = 0; c < 12; ++c) {
    const Json& configuration = block["configurations"][c];
    const auto column = static_cast<Index>(c);
    for (std::size_t j = 0; j < 5; ++j) {
      EXPECT_EQ(configuration["joint_values"][j], m.measured.joint_values(static_cast<Index>(j), column));
      EXPECT_NEAR(configuration["effective"][j], effective(static_cast<Index>(j), column), 1e-15);
    }
  }
  const Json rigid =
      measurements_block({.model = m.robot.model, .estimate = m.before, .measurements = m.measured, .before = nullptr});
  for (const auto& configuration : rigid["configurations"]) {
    EXPECT_FALSE(configuration.contains("effective")) << "all effects are zero";
  }
}

TEST(ReportBlocks, RegionAndRangesAreThoseOfTheFittedRows) {
  Measured m;
  const auto expect_reach = [&](bool all) {
    Eigen::AlignedBox3d region;
    for (const Observation& o : m.measured.observations) {
      if (all || o.configuration < 9) {
        region.extend(Vector3d(m.robot.truth.frames.base().inverse() * o.position()));
      }
    }
    const Json block = m.block();
    EXPECT_LT((vector_of(block["region"]["lower"]) - region.min()).norm(), 1e-12);
    EXPECT_LT((vector_of(block["region"]["upper"]) - region.max()).norm(), 1e-12);
    const MatrixXd q = m.measured.joint_values.leftCols(all ? 12 : 9);
    for (std::size_t j = 0; j < 5; ++j) {
      const auto values = q.row(static_cast<Index>(j));
      EXPECT_EQ(block["ranges"][j], Json::array({values.minCoeff(), values.maxCoeff()}));
    }
  };
  expect_reach(false);
  for (Observation& o : m.measured.observations) {
    o.split = Split::test;
  }
  expect_reach(true);
  m.measured.observations.clear();
  EXPECT_EQ(m.block()["region"], nullptr);
  EXPECT_EQ(m.block()["ranges"], Json::array({nullptr, nullptr, nullptr, nullptr, nullptr}));
}

TEST(ReportBlocks, ConfigurationsOfManyRowsAreNumberedAsTheyAreShown) {
  Measured m(501);
  m.measured.observations.resize(3006);
  ASSERT_EQ(m.measured.observations.size(), 3006U);
  std::reverse(m.measured.observations.begin(), m.measured.observations.end());
  const Json block = m.block();
  EXPECT_EQ(block["complete"], false);
  EXPECT_EQ(block["rows"], 3006);
  for (const Json& point : block["points"]) {
    const Observation& o = m.measured.observations[point["row"].get<std::size_t>()];
    EXPECT_EQ(block["configurations"].at(point["configuration"].get<std::size_t>())["name"],
              m.measured.configurations[static_cast<std::size_t>(o.configuration)]);
  }
}

// By hand: turn = J1, slide = -J2, skew = J3 + 0.25, elbow = 2 J4, wrist = J5 + J4.
TEST(ReportBlocks, JointsOfAConventionAreTheControllers) {
  const Measured m;
  JointConvention convention{.name = "c", .controller_joints = {"J1", "J2", "J3", "J4", "J5"}};
  for (const MovingJoint& joint : m.model.joints) {
    convention.urdf_joints.push_back(joint.name);
  }
  convention.matrix = Eigen::Vector<double, 5>(1.0, -1.0, 1.0, 2.0, 1.0).asDiagonal();
  convention.matrix(4, 3) = 1.0;
  convention.offset = VectorXd::Unit(5, 2) * 0.25;
  const Json block = measurements_block(
      {.model = m.robot.model, .estimate = m.robot.truth, .measurements = m.measured, .convention = convention});
  EXPECT_EQ(block["joints"], Json::parse(R"([
    {"name": "J1", "type": "revolute", "urdf": {"turn": 1.0}, "constant": 0.0, "lower": -3.0, "upper": 3.0},
    {"name": "J2", "type": "prismatic", "urdf": {"slide": -1.0}, "constant": 0.0, "lower": -0.5, "upper": 0.5},
    {"name": "J3", "type": "continuous", "urdf": {"skew": 1.0}, "constant": -0.25, "lower": null, "upper": null},
    {"name": "J4", "type": "revolute", "urdf": {"elbow": 0.5}, "constant": 0.0, "lower": -1.0, "upper": 1.0},
    {"name": "J5", "type": "revolute", "urdf": {"elbow": -0.5, "wrist": 1.0}, "constant": 0.0, "lower": null,
     "upper": null}])"));
  const Json urdf = m.block()["configurations"];
  double lower = kInfinity;
  for (std::size_t c = 0; c < 12; ++c) {
    const Json& q = urdf[c]["joint_values"];
    const Json& shown = block["configurations"][c]["controller"];
    EXPECT_EQ(block["configurations"][c]["joint_values"], q);
    EXPECT_FALSE(urdf[c].contains("controller"));
    EXPECT_NEAR(shown[1], -q[1].get<double>(), 1e-15);
    EXPECT_NEAR(shown[2], q[2].get<double>() - 0.25, 1e-15);
    EXPECT_NEAR(shown[3], 0.5 * q[3].get<double>(), 1e-15);
    EXPECT_NEAR(shown[4], q[4].get<double>() - 0.5 * q[3].get<double>(), 1e-15);
    lower = c < 9 ? std::min(lower, -q[1].get<double>()) : lower;
  }
  EXPECT_NEAR(block["ranges"][1][0], lower, 1e-15);
}

TEST(ReportBlocks, ShownRowsAreAllUpTo3000AndOfMoreTheLargestAreAmongThem) {
  Random random(7);
  for (const std::size_t count : {0U, 1U, 2999U, 3000U, 3001U, 7003U}) {
    std::vector<double> distances(count);
    for (double& distance : distances) {
      distance = random.uniform(0.0, 500.0);
    }
    const std::vector<std::size_t> rows = shown_rows(distances);
    EXPECT_TRUE(std::is_sorted(rows.begin(), rows.end())) << count;
    EXPECT_EQ(std::set<std::size_t>(rows.begin(), rows.end()).size(), rows.size()) << count;
    EXPECT_LE(rows.size(), 3000U) << count;
    EXPECT_GE(rows.size(), std::min<std::size_t>(count, 2800)) << count;
    std::vector<double> left_out;
    std::size_t last = 0;
    for (std::size_t row = 0; row < count; ++row) {
      if (std::binary_search(rows.begin(), rows.end(), row)) {
        EXPECT_LE(row - last, 3U) << "a gap before row " << row << " of " << count;
        last = row;
      } else {
        left_out.push_back(distances[row]);
      }
    }
    std::sort(distances.begin(), distances.end());
    if (!left_out.empty()) {
      EXPECT_LT(*std::max_element(left_out.begin(), left_out.end()), distances[count - 200]) << count;
    }
  }
  const std::vector<std::size_t> of_equal = shown_rows(std::vector<double>(5000, 1.0));
  for (std::size_t row = 0; row < 200; ++row) {
    ASSERT_EQ(of_equal.at(row), row) << "of rows that are all as large the first are shown";
  }
}

/// A saved result of every effect that is a function of joint values, and one that is not.
struct Saved {
  testing::VirtualExperiment arm{{.model = complete_model(parse_robot(testing::kOddArm)), .random = Random(8)}};
  Measurements measured;
  CalibrationParts saved;

  Saved() {
    const MatrixXd q = arm.configurations(30);
    const DrivenConfigurations driven = simulated_signals(arm.model, q, {}, {.approach = true, .torques = true});
    saved.model = arm.model;
    for (const std::string& group : effect_group_names()) {
      const std::vector<EffectTerm> terms = effect_terms(arm.model, *effect_group(group), q, driven.signals);
      saved.model.effects.insert(saved.model.effects.end(), terms.begin(), terms.end());
    }
    for (const EffectTerm& term : ripple_terms(arm.model, q, 3, 37.5)) {
      saved.model.effects.push_back(term);
    }
    measured = arm.measure(q, {.sigma = 1e-4});
    for (Observation& o : measured.observations) {
      o.split = o.configuration < 25 ? Split::train : Split::test;
    }
    saved.free = arm.free.with_group(saved.model, UnknownGroup::effects);
    saved.estimate = arm.robot.truth;
    const auto count = static_cast<Index>(saved.model.effects.size());
    saved.estimate.effects = VectorXd::NullaryExpr(count, [&](Index) { return 1e-3 * arm.random.normal(); });
    const MatrixXd root = MatrixXd::NullaryExpr(saved.free.size(), saved.free.size(),
                                                [&](Index, Index) { return 1e-4 * arm.random.normal(); });
    saved.covariance = root * root.transpose();
  }
};

// By the joint values that the arm would really have with this effect alone.
TEST(ReportBlocks, CurvesAreWhatEffectsDoOverTheMeasuredRanges) {
  const Saved s;
  const JointRanges ranges = trained_ranges(s.measured);
  const Json curves = effects_block(s.saved, s.measured);
  VectorXd middle(5);
  for (Index j = 0; j < 5; ++j) {
    const auto& [from, to] = ranges[static_cast<std::size_t>(j)];
    middle[j] = 0.5 * (from + to);
  }
  std::size_t looked_at = 0;
  for (const Json& curve : curves) {
    const int joint = curve["joint_index"];
    const auto group = *effect_group(curve["group"].get<std::string>());
    EXPECT_EQ(curve["joint"], s.saved.model.joints[static_cast<std::size_t>(joint)].name);
    ASSERT_EQ(curve["curve"].size(), group == EffectGroup::ripple || group == EffectGroup::tables ? 301U : 61U);
    const auto& [lower, upper] = ranges[static_cast<std::size_t>(joint)];
    if (group != EffectGroup::ripple) {
      EXPECT_NEAR(curve["curve"].front()[0], lower, 1e-12);
      EXPECT_NEAR(curve["curve"].back()[0], upper, 1e-12);
    }
    if (curve["about"] != to_string(EffectAxis::own)) {
      continue;
    }
    Estimate alone = s.saved.estimate;
    for (std::size_t e = 0; e < s.saved.model.effects.size(); ++e) {
      if (s.saved.model.effects[e].group() != group) {
        alone.effects[static_cast<Index>(e)] = 0.0;
      }
    }
    for (const Json& point : curve["curve"]) {
      if (point[1].is_null()) {
        continue;
      }
      VectorXd q = middle;
      q[joint] = point[0];
      const DriveSignals none{.approach = {}, .torques = MatrixXd::Zero(5, 1)};
      const MatrixXd there = effective_joint_values(s.saved.model, alone.effects, q, none);
      EXPECT_NEAR(point[1], there(joint, 0) - q[joint], 1e-10) << curve["group"] << joint;
      EXPECT_GE(point[2], 0.0);
    }
    ++looked_at;
  }
  EXPECT_GT(looked_at, 20U);
}

TEST(ReportBlocks, CurvesHaveGapsWhereNothingWasFittedAndWhereATableIsWithheld) {
  Saved s;
  auto slide = s.measured.joint_values.row(1);  // the last five are of test rows
  slide << Eigen::RowVectorXd::LinSpaced(12, -0.5, -0.3115), Eigen::RowVectorXd::LinSpaced(13, 0.3115, 0.5),
      Eigen::RowVectorXd::Zero(5);
  for (EffectTerm& term : s.saved.model.effects) {
    if (auto* table = std::get_if<JointTable>(&term.function)) {
      table->lower = -0.5;
      table->upper = 0.5;
      table->withheld = {{0.3605, 0.4105}};
    }
  }
  int curves = 0;
  for (const Json& curve : effects_block(s.saved, s.measured)) {
    if (curve["joint_index"] != 1 || curve["group"] == "ripple") {
      continue;
    }
    ++curves;
    for (const Json& point : curve["curve"]) {
      const double q = point[0];
      const bool far = std::abs(q) < 0.2115;
      const bool withheld = curve["group"] == "tables" && q > 0.3605 && q < 0.4105;
      EXPECT_EQ(point[1].is_null(), far || withheld) << curve["group"] << q;
      EXPECT_EQ(point[2].is_null(), far || withheld) << curve["group"] << q;
    }
  }
  EXPECT_GT(curves, 3);
}

TEST(ReportBlocks, ACurveOfWhatIsNotDeterminedHasNoBandAndOneOfNoRangeIsNone) {
  Saved s;
  const ColumnRange columns = s.saved.free.range(UnknownGroup::effects);
  s.saved.covariance(columns.first, columns.first) = kInfinity;  // of gravity about joint 1
  const Json curves = effects_block(s.saved, s.measured);
  EXPECT_EQ(curves[0]["curve"][0][2], nullptr);
  EXPECT_TRUE(curves[1]["curve"][0][2].is_number());
  s.saved.free = s.arm.free;  // which knows of no effect
  s.saved.covariance.setIdentity(s.saved.free.size(), s.saved.free.size());
  EXPECT_EQ(effects_block(s.saved, s.measured)[1]["curve"][0][2], nullptr);
  for (Observation& o : s.measured.observations) {
    o.split = Split::test;
  }
  EXPECT_EQ(effects_block(s.saved, s.measured), Json::array());
}

// A joint that turns by less than three swings shows what it turns.
TEST(ReportBlocks, ShortRangesOfRippleAreShownWhole) {
  Saved s;
  s.saved.model.effects = ripple_terms(s.arm.model, s.measured.joint_values, 3, 4.5);
  s.saved.estimate.effects = Eigen::Vector2d(1e-3, 2e-3);
  for (Observation& o : s.measured.observations) {
    o.split = o.configuration < 2 ? Split::train : Split::test;
  }
  const auto [lower, upper] = trained_ranges(s.measured)[3];
  ASSERT_LT(upper - lower, 6.0 * std::numbers::pi / 4.5);
  const Json curve = effects_block(s.saved, s.measured)[0]["curve"];
  EXPECT_NEAR(curve[0][0], lower, 1e-12);
  EXPECT_NEAR(curve[300][0], upper, 1e-12);
}

Json written(const MatrixXd& C) {
  Json names = Json::array();
  Json rows = Json::array();
  for (Index r = 0; r < C.rows(); ++r) {
    names.push_back("p" + std::to_string(r));
    Json row = Json::array();
    for (Index c = 0; c < C.cols(); ++c) {
      row.push_back(finite_or_null(C(r, c)));
    }
    rows.push_back(row);
  }
  return {{"names", names}, {"matrix", rows}};
}

TEST(ReportBlocks, TheStrongestCorrelationsAndTheMatrixOfTheirParameters) {
  MatrixXd C(4, 4);
  C << 4.0, 1.0, -3.0, 0.0, 1.0, 1.0, 0.0, 0.0, -3.0, 0.0, 9.0, 0.0, 0.0, 0.0, 0.0, kInfinity;
  const Json small = correlations_block(written(C));
  EXPECT_EQ(small["names"], (Json{"p0", "p1", "p2", "p3"}));
  EXPECT_EQ(small["matrix"],
            (Json{{1.0, 0.5, -0.5, 0.0}, {0.5, 1.0, 0.0, 0.0}, {-0.5, 0.0, 1.0, 0.0}, {0.0, 0.0, 0.0, 1.0}}));
  EXPECT_EQ(small["strongest"][0], (Json{"p0", "p1", 0.5}));
  EXPECT_EQ(small["strongest"][1], (Json{"p0", "p2", -0.5}));
  EXPECT_EQ(small["strongest"].size(), 6U);

  Random random(30);
  const MatrixXd root = MatrixXd::NullaryExpr(30, 30, [&](Index, Index) { return random.normal(); });
  C = root * root.transpose();
  const Json large = correlations_block(written(C));
  ASSERT_EQ(large["strongest"].size(), 12U);
  ASSERT_EQ(large["names"].size(), 14U);
  ASSERT_EQ(large["matrix"].size(), 14U);
  std::vector<double> all;
  for (Index r = 0; r < 30; ++r) {
    for (Index c = 0; c < r; ++c) {
      all.push_back(std::abs(C(r, c)) / std::sqrt(C(r, r) * C(c, c)));
    }
  }
  std::sort(all.rbegin(), all.rend());
  for (std::size_t i = 0; i < 12; ++i) {
    EXPECT_NEAR(std::abs(large["strongest"][i][2].get<double>()), all[i], 1e-12);
  }
}

}  // namespace
}  // namespace kdl_calibration::report_blocks_test
