// Blocks of a result that grow with the data: what is left out of large ones.

#include "results/result_blocks.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "support.hpp"

namespace kdl_calibration::result_blocks_test {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The FANUC at one place, with rows that are off by so many tenths of a millimetre along z.
struct Rows {
  Measurements measured;
  CalibrationResult calibration;

  explicit Rows(const std::vector<double>& off) {
    calibration.model = complete_model(testing::fanuc());
    Estimate& estimate = calibration.fit.identification.estimate;
    estimate.errors = testing::errors_of(calibration.model);
    estimate.frames.targets = testing::targets_at({{0.0, 0.0, 0.0}, {0.0, 0.0, 0.1}});
    measured.joint_values = Eigen::MatrixXd::Zero(6, 2);
    measured.configurations = {"first", "second"};
    measured.targets = {"A", "B"};
    const KDL::Frame pose =
        testing::kdl_pose(error_chain(calibration.model, estimate.errors), Eigen::VectorXd::Zero(6));
    for (std::size_t i = 0; i < off.size(); ++i) {
      const bool second = i % 3 == 1;
      const KDL::Vector p = pose * KDL::Vector(0.0, 0.0, second ? 0.1 : 0.0);
      measured.observations.push_back({.reading = Point{Eigen::Vector3d(p.x(), p.y(), p.z() + 1e-4 * off[i])},
                                       .configuration = i % 2 == 1 ? 1 : 0,
                                       .target = second ? 1 : 0,
                                       .repeat = static_cast<std::int32_t>(i),
                                       .split = i % 5 == 0 ? Split::test : Split::train});
    }
  }
};

TEST(ResultBlocks, ResidualsAreAllRowsUpTo5000AndThe200LargestOfMore) {
  for (const std::size_t count : {5000U, 5001U}) {
    std::vector<double> off(count);
    for (std::size_t i = 0; i < count; ++i) {
      off[i] = static_cast<double>((i * 7919) % 5003);  // each another
    }
    const Rows rows(off);
    const Json json = residuals_json(rows.measured, rows.calibration);
    std::vector<std::size_t> order(count);
    for (std::size_t i = 0; i < count; ++i) {
      order[i] = i;
    }
    const bool all = count <= 5000;
    if (!all) {
      std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return off[a] > off[b]; });
      order.resize(200);
    }
    EXPECT_EQ(json.contains("rows"), all);
    EXPECT_EQ(json.contains("largest"), !all);
    const Json& shown = json[all ? "rows" : "largest"];
    ASSERT_EQ(shown.size(), order.size());
    for (std::size_t i = 0; i < order.size(); ++i) {
      const std::size_t row = order[i];
      EXPECT_NEAR(shown[i]["distance"], 1e-4 * off[row], 1e-12);
      EXPECT_NEAR(shown[i]["residual"][2], 1e-4 * off[row], 1e-12);
      EXPECT_EQ(shown[i]["configuration"], row % 2 == 1 ? "second" : "first");
      EXPECT_EQ(shown[i]["target"], row % 3 == 1 ? "B" : "A");
      EXPECT_EQ(shown[i]["split"], row % 5 == 0 ? "test" : "train");
    }
    EXPECT_EQ(json["statistics"]["count"], count);
    EXPECT_NEAR(json["statistics"]["max"], 1e-4 * *std::max_element(off.begin(), off.end()), 1e-9);
  }
}

// Rows that are exactly alike stand in the order of the file.
TEST(ResultBlocks, OfRowsThatAreAllAlikeTheFirstAreShown) {
  Rows rows(std::vector<double>(5001, 0.0));
  for (Observation& o : rows.measured.observations) {
    o = rows.measured.observations.front();
  }
  for (std::size_t i = 0; i < rows.measured.observations.size(); ++i) {
    rows.measured.observations[i].repeat = static_cast<std::int32_t>(i);
  }
  const Json json = residuals_json(rows.measured, rows.calibration);
  for (std::size_t i = 0; i < 200; ++i) {
    EXPECT_EQ(json["largest"].at(i)["repeat"], i);
  }
}

TEST(ResultBlocks, TheCovarianceIsWrittenUpTo300Columns) {
  for (const std::size_t count : {1U, 2U, 300U, 301U}) {
    CalibrationResult calibration;
    calibration.model = complete_model(testing::fanuc());
    calibration.model.effects.resize(count);
    calibration.fit.free = Unknowns().with_group(calibration.model, UnknownGroup::effects);
    const auto size = static_cast<Eigen::Index>(count);
    calibration.uncertainty.covariance = Eigen::MatrixXd::NullaryExpr(
        size, size, [](Eigen::Index r, Eigen::Index c) { return static_cast<double>(1000 * r + c); });
    calibration.uncertainty.covariance(0, 0) = kInfinity;
    const Json json = covariance_json(calibration);
    EXPECT_EQ(json.is_null(), count > 300) << count;
    if (!json.is_null()) {
      ASSERT_EQ(json["matrix"].size(), count);
      for (std::size_t r = 0; r < count; ++r) {
        ASSERT_EQ(json["lower_triangle"][r].size(), r + 1);
        EXPECT_EQ(json["lower_triangle"][r].back(), json["matrix"][r][r]);
        EXPECT_EQ(json["lower_triangle"][r].front(), json["matrix"][r][0]);
      }
      EXPECT_EQ(json["matrix"][0][0], nullptr);
      EXPECT_EQ(json["matrix"].back().size(), count);
      EXPECT_EQ(json["matrix"][0].size(), count);
      EXPECT_EQ(json["matrix"].back().back(),
                count == 1 ? Json(nullptr) : Json(1001.0 * static_cast<double>(count - 1)));
      EXPECT_EQ(json["names"].size(), count);
    }
    calibration.uncertainty.covariance.resize(0, 0);  // of a fit that did not arrive
    EXPECT_TRUE(covariance_json(calibration).is_null());
  }
}

TEST(ResultBlocks, HeldOutPointsAreWrittenUpTo5000) {
  Rows rows({0.0});
  EXPECT_TRUE(held_out_points_json(rows.measured, rows.calibration).is_null());
  std::vector<HeldOutPoint>& points = rows.calibration.held_out_points;
  points.assign(5000, {.configuration = 1, .target = 1, .residual = Eigen::Vector3d(2.0, 3.0, 6.0)});
  points[1].residual.y() = std::nan("");
  const Json json = held_out_points_json(rows.measured, rows.calibration);
  ASSERT_EQ(json.size(), 5000U);
  EXPECT_EQ(json[0], Json({{"configuration", "second"},
                           {"target", "B"},
                           {"residual", Json::array({2.0, 3.0, 6.0})},
                           {"distance", 7.0}}));
  EXPECT_EQ(json[1]["residual"], nullptr);
  EXPECT_EQ(json[1]["distance"], nullptr);
  points.push_back(points[0]);
  EXPECT_TRUE(held_out_points_json(rows.measured, rows.calibration).is_null());
}

TEST(ResultBlocks, ProvenanceNamesNotesAndFiles) {
  const Json json = provenance_json({.notes = {{"serial", "7"}, {"payload", "2 kg"}},
                                     .options = {{"--exclude", "3"}},
                                     .planned_cell = "--frame base",
                                     .files_read = {{.role = "urdf", .path = "a.urdf", .sha256 = "1f"}},
                                     .files_written = {{.role = "output", .path = "b.json", .sha256 = "2e"}}});
  EXPECT_EQ(json, Json::parse(R"({"notes": {"serial": "7", "payload": "2 kg"},
      "options": {"--exclude": "3"}, "planned_cell": "--frame base",
      "files_read": [{"role": "urdf", "path": "a.urdf", "sha256": "1f"}],
      "files_written": [{"role": "output", "path": "b.json", "sha256": "2e"}]})"));
}

TEST(ResultBlocks, QuaternionsHaveNoNegativeW) {
  Random random(3);
  int negative = 0;
  for (int i = 0; i < 40; ++i) {
    const Eigen::Quaterniond q =
        Eigen::Quaterniond{random.normal(), random.normal(), random.normal(), random.normal()}.normalized();
    negative += Eigen::Quaterniond(q.toRotationMatrix()).w() < 0.0 ? 1 : 0;
    const double sign = q.w() < 0.0 ? -1.0 : 1.0;
    const Json json = quaternion(q.toRotationMatrix());
    EXPECT_NEAR(json[0], sign * q.w(), 1e-12);
    EXPECT_NEAR(json[1], sign * q.x(), 1e-12);
    EXPECT_NEAR(json[2], sign * q.y(), 1e-12);
    EXPECT_NEAR(json[3], sign * q.z(), 1e-12);
  }
  EXPECT_GT(negative, 0) << "Eigen never gave a negative w";
}

TEST(ResultBlocks, TablesOfFilesHaveARowForEach) {
  const Rows rows({1.0, 2.0});
  EXPECT_EQ(residuals_csv(rows.measured, rows.calibration).substr(0, 61),
            "configuration,repeat,target,split,dx[m],dy[m],dz[m],distance[");
  EXPECT_THAT(residuals_csv(rows.measured, rows.calibration),
              ::testing::ContainsRegex("\nfirst,0,A,test,[^\n]*,[^\n]*,[^\n]*\nsecond,1,B,train,[^\n]*\n$"));
  CalibrationResult calibration = rows.calibration;
  calibration.model.effects.resize(2);
  calibration.model.effects[0].name = "a";
  calibration.model.effects[1].name = "b,c";
  calibration.fit.free = Unknowns().with_group(calibration.model, UnknownGroup::effects);
  calibration.uncertainty.covariance = (Eigen::Matrix2d() << 1.0, 0.5, 0.25, kInfinity).finished();
  EXPECT_EQ(covariance_csv(calibration), "parameter,a,\"b,c\"\na,1,0.5\n\"b,c\",0.25,\n");
}

}  // namespace
}  // namespace kdl_calibration::result_blocks_test
