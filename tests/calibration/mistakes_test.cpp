// What a calibration says of data that read well and are wrong, and of data that are right.

#include <gmock/gmock.h>

#include <algorithm>
#include <set>
#include <string>

#include "kdl_calibration/calibration.hpp"
#include "kdl_calibration/joint_convention.hpp"
#include "kdl_calibration/measurements_file.hpp"
#include "mistake_table.hpp"

namespace kdl_calibration::testing::mistakes_test {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;

/// One line for each doubt and each finding about the data themselves.
std::string said(const Calibration& found) {
  std::string text;
  for (const Doubt& doubt : found.doubts) {
    text += doubt.cause + ": " + doubt.message + "\n";
  }
  for (const QualityFinding& finding : found.findings) {
    text += "finding: " + finding.message + "\n";
  }
  return text;
}

bool doubts_for(const Calibration& found, const std::string& cause, const std::string& words) {
  return std::any_of(found.doubts.begin(), found.doubts.end(), [&](const Doubt& doubt) {
    return doubt.cause == cause && doubt.message.find(words) != std::string::npos;
  });
}

const CalibrationOptions kNothingHeldOut{.held_out = false};  // which says nothing of the readings of the data

// No more than one explanation of the data, the right one.
void expect_named(const Mistake& mistake, const ErrorModel& model, std::uint64_t seed,
                  const CalibrationOptions& options = kNothingHeldOut) {
  Measured m = measured(model, seed, mistake.draw);
  mistake.make(m);
  const Calibration found = calibrate(model, m.data, options);
  const std::string where = mistake.name + ", " + model.joints.front().name + ", seed " + std::to_string(seed);
  EXPECT_FALSE(found.trusted()) << where;
  EXPECT_TRUE(doubts_for(found, mistake.cause, mistake.words)) << where << "\n" << said(found);
  EXPECT_EQ(std::count_if(found.suspicions.begin(), found.suspicions.end(), [](const auto& s) { return s.doubt; }), 1)
      << where << "\n"
      << said(found);
}

std::vector<Mistake> table() {
  std::vector<Mistake> all = joint_mistakes();
  for (const std::vector<Mistake>& more : {point_mistakes(), order_mistakes()}) {
    all.insert(all.end(), more.begin(), more.end());
  }
  return all;
}

/// Every so many-th mistake of the table, from the first one given.
void expect_cross_section_named(std::size_t first, std::size_t step,
                                const CalibrationOptions& options = kNothingHeldOut) {
  const std::vector<Mistake> all = table();
  for (std::size_t i = first; i < all.size(); i += step) {
    expect_named(all[i], i % 2 == 0 ? large_arm() : light_arm(), 4, options);
  }
}

const CalibrationOptions kAutomatic{
    .automatic_priors = true, .effects = {.groups = {}, .automatic = true}, .held_out = false};

TEST(Mistakes, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 15); }
TEST(MistakesLongRun, ACrossSectionOfTheTableIsDoubted) { expect_cross_section_named(0, 5); }

// Neither effects nor priors explain a mistake away.
TEST(Mistakes, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 25, kAutomatic); }
TEST(MistakesLongRun, AreDoubtedBesideAutomaticChoices) { expect_cross_section_named(2, 5, kAutomatic); }

TEST(MistakesCampaign, TheWholeTableIsDoubtedOnTwoRobotsWithThreeSeeds) {
  const std::vector<Mistake> all = table();
  EXPECT_GE(all.size(), 40U);
  for (const Mistake& mistake : all) {
    for (const ErrorModel* model : {&large_arm(), &light_arm()}) {
      for (std::uint64_t seed = 1; seed <= 3; ++seed) {
        expect_named(mistake, *model, seed);
      }
    }
  }
}

// ---- correct data --------------------------------------------------------------------------------------------------

int false_alarms(std::uint64_t first, std::uint64_t last) {
  const std::set<std::string> never = {"joint_unit",       "joint_sign", "joint_columns",
                                       "joint_convention", "joint_gain", "length_unit",
                                       "mirrored",         "tool_frame", "scale"};
  int alarms = 0;
  for (std::uint64_t seed = first; seed <= last; ++seed) {
    const Measured m = correct_data(seed);
    const Calibration found = calibrate(m.model, m.data, kNothingHeldOut);
    for (const Suspicion& suspicion : found.suspicions) {
      EXPECT_EQ(never.count(suspicion.cause), 0U) << seed << ": " << suspicion.message;
    }
    const bool doubted = std::any_of(found.suspicions.begin(), found.suspicions.end(),
                                     [](const Suspicion& suspicion) { return suspicion.doubt; });
    alarms += doubted || !found.findings.empty() ? 1 : 0;
    EXPECT_LE(alarms, 1) << seed << "\n" << said(found);
  }
  return alarms;
}

TEST(Mistakes, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 4), 1); }
TEST(MistakesLongRun, CorrectDataOfRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 15), 1); }

TEST(MistakesCampaign, CorrectDataOfThreeHundredRandomArmsAreLeftAlone) { EXPECT_LE(false_alarms(1, 300), 1); }

// ---- how often what was changed is found ---------------------------------------------------------------------------

constexpr double kSigma = 0.00003;  // [m], of Draw

/// 10 sigma, in a direction of its own.
Vector3d ten_sigma(std::uint64_t seed) {
  Random random(seed, 3);
  return 10.0 * kSigma * Vector3d{random.normal(), random.normal(), random.normal()}.normalized();
}

int place(std::uint64_t seed) { return 5 + static_cast<int>(seed % 21); }

// About an axis through the base, so that a point as far from it as those measured moves by 10 sigma.
Mistake turned_by_ten_sigma(const Measured& m, std::uint64_t seed) {
  double squares = 0.0;
  for (const Observation& observation : m.data.observations) {
    squares += (observation.position - m.truth.X_WB.translation()).squaredNorm();
  }
  const double lever = std::sqrt(squares / static_cast<double>(m.data.observations.size()));
  const Vector3d angles = ten_sigma(seed) / lever;
  const Eigen::Isometry3d X_WB = m.truth.X_WB;
  const int from = place(seed);
  return {"turn",
          [=](Measured& changed) {
            for_rows(changed, [&](Observation& o) {
              if (o.configuration >= from) {
                o.position = X_WB.translation() + rotation_exp(angles) * (o.position - X_WB.translation());
              }
            });
          },
          "moved_base", "after configuration " + std::to_string(from)};
}

Mistake drifted_by_ten_sigma(std::uint64_t seed) {
  const Vector3d whole = ten_sigma(seed);
  return {"drift",
          [=](Measured& m) { for_rows(m, [&](Observation& o) { o.position += o.configuration / 29.0 * whole; }); },
          "drift", "drifts"};
}

std::uint64_t found_of(std::uint64_t seeds, const std::function<Mistake(const Measured&, std::uint64_t)>& mistake) {
  std::uint64_t named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), 1000 + seed);
    const Mistake made = mistake(m, seed);
    made.make(m);
    const Calibration found = calibrate(m.model, m.data, kNothingHeldOut);
    const bool right = doubts_for(found, made.cause, "");
    named += right ? 1U : 0U;
    if (!right) {
      std::printf("%s, seed %d: %s\n", made.name.c_str(), static_cast<int>(seed), said(found).c_str());
    }
  }
  std::printf("%d of %d\n", static_cast<int>(named), static_cast<int>(seeds));
  return named;
}

Mistake stepped(const Measured& /*m*/, std::uint64_t seed) { return moved_from(place(seed), ten_sigma(seed)); }
Mistake drifted(const Measured& /*m*/, std::uint64_t seed) { return drifted_by_ten_sigma(seed); }

TEST(Mistakes, AMovedTrackerIsDoubted) {
  EXPECT_GE(found_of(2, stepped), 2U);
  EXPECT_GE(found_of(1, turned_by_ten_sigma), 1U);
  EXPECT_GE(found_of(1, drifted), 1U);
}

// What 98 % give at least in 200 draws, two standard deviations of the count below their mean.
constexpr std::uint64_t kOfTwoHundred = 192;

TEST(MistakesLongRun, AStepOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, stepped), kOfTwoHundred);
}
TEST(MistakesLongRun, ATurnOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, turned_by_ten_sigma), kOfTwoHundred);
}
TEST(MistakesLongRun, ADriftOfTenSigmaIsDoubtedInNinetyEightPercent) {
  EXPECT_GE(found_of(200, drifted), kOfTwoHundred);
}

// Slips and typing errors are findings, and nothing else is made of them.
std::uint64_t findings_of(std::uint64_t seeds, QualityKind kind,
                          const std::function<void(Measured&, std::uint64_t)>& spoil) {
  std::uint64_t named = 0;
  for (std::uint64_t seed = 1; seed <= seeds; ++seed) {
    Measured m = measured(seed % 2 == 0 ? large_arm() : light_arm(), 2000 + seed);
    spoil(m, seed);
    const Calibration found = calibrate(m.model, m.data, kNothingHeldOut);
    const bool right = found.findings.size() == 1 && found.findings.front().kind == kind;
    named += right ? 1U : 0U;
    if (!right) {
      std::printf("seed %d: %s\n", static_cast<int>(seed), said(found).c_str());
    }
  }
  std::printf("%d of %d\n", static_cast<int>(named), static_cast<int>(seeds));
  return named;
}

// 1 mm along the flange's x, which only one of three targets does.
void slip(Measured& m, std::uint64_t seed) {
  const int target = static_cast<int>(seed % 3);
  for_rows(m, [&](Observation& o) {
    if (o.configuration >= place(seed) && o.target == target) {
      o.position += true_flange(m, o.configuration).linear() * Vector3d(0.001, 0.0, 0.0);
    }
  });
}

void mistype(Measured& m, std::uint64_t seed) {
  Observation& row = m.data.observations[seed * 7 % m.data.observations.size()];
  row.position[static_cast<Eigen::Index>(seed % 3)] += 0.0005;
}

TEST(Mistakes, SlipsAndTypingErrorsAreFindings) {
  EXPECT_GE(findings_of(2, QualityKind::slipped_target, slip), 2U);
  EXPECT_GE(findings_of(2, QualityKind::mistyped_coordinate, mistype), 2U);
}

TEST(MistakesLongRun, SlipsOfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(findings_of(200, QualityKind::slipped_target, slip), kOfTwoHundred);
}
TEST(MistakesLongRun, TypingErrorsOfHalfAMillimetreAreFoundInNinetyEightPercent) {
  EXPECT_GE(findings_of(200, QualityKind::mistyped_coordinate, mistype), kOfTwoHundred);
}

// ---- real arms -----------------------------------------------------------------------------------------------------

struct RealSet {
  ErrorModel model;
  Measurements data;
  CalibrationOptions options;
};

RealSet fanuc_series() {
  const Robot robot = fanuc();
  RealSet set{.model = complete_model(robot), .data = {}, .options = kNothingHeldOut};
  set.options.convention = read_joint_convention(std::string(URDF_DIR) + "/fanuc_r2000ic_165f_serial.json");
  set.data = read_measurements(robot, std::string(SHARED_DATA_DIR) + "/r2000ic_165f_tracker/measurements.csv",
                               &*set.options.convention);
  return set;
}

RealSet ur10_poses() {
  const std::string folder = std::string(SHARED_DATA_DIR) + "/ur10_tracker_poses";
  const Robot robot = load_robot(folder + "/ur10.urdf", {.base = "base_link", .tip = "tool0"});
  return {.model = complete_model(robot),
          .data = read_measurements(robot, folder + "/measurements.csv"),
          .options = kNothingHeldOut};
}

std::vector<std::string> causes_of(const RealSet& set) {
  std::vector<std::string> causes;
  const Calibration found = calibrate(set.model, set.data, set.options);
  for (const Suspicion& suspicion : found.suspicions) {
    causes.push_back(suspicion.cause + ": " + suspicion.message);
  }
  for (const QualityFinding& finding : found.findings) {
    causes.push_back("finding: " + finding.message);
  }
  return causes;
}

TEST(MistakesOnRealData, NothingIsSaidOfWhatIsRight) {
  for (const RealSet& set : {fanuc_series(), ur10_poses()}) {
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

TEST(MistakesOnRealDataLongRun, NothingIsSaidOfWhatIsRightBesideAutomaticChoices) {
  for (RealSet set : {fanuc_series(), ur10_poses()}) {
    set.options.effects.automatic = true;
    set.options.automatic_priors = true;
    EXPECT_THAT(causes_of(set), ::testing::IsEmpty());
  }
}

// Of a controller whose joints a convention makes others of, the controller's columns are what is exchanged.
TEST(MistakesOnRealData, ColumnsOfTheControllerThatWereExchangedAreNamed) {
  RealSet set = fanuc_series();
  const Eigen::MatrixXd matrix = set.options.convention->matrix;
  Eigen::MatrixXd controller = matrix.inverse() * set.data.joint_values;
  controller.row(0).swap(controller.row(1));
  set.data.joint_values = matrix * controller;
  EXPECT_THAT(causes_of(set), ::testing::ElementsAre(HasSubstr("the controller's J1 and J2 exchanged")));
}

// The measured frame stands on the axis of the last joint: its orientation alone shows how that turns.
TEST(MistakesOnRealData, OrientationsShowWhatPointsDoNot) {
  RealSet wrong_sign = ur10_poses();
  wrong_sign.data.joint_values.row(5) *= -1.0;
  EXPECT_THAT(causes_of(wrong_sign), ::testing::ElementsAre(::testing::AllOf(
                                         HasSubstr("joint_sign"), HasSubstr("(orientations as points 100 mm away)"),
                                         HasSubstr("wrist_3_joint with the opposite sign"))));
}

TEST(MistakesOnRealDataLongRun, OrientationsShowDegreesWherePointsDoNot) {
  RealSet degrees = ur10_poses();
  degrees.data.joint_values.row(5) /= kDegree;
  EXPECT_THAT(causes_of(degrees), ::testing::ElementsAre(HasSubstr("wrist_3_joint in degrees, read as radians")));
}

}  // namespace
}  // namespace kdl_calibration::testing::mistakes_test
