// A result that is read back predicts as the calibration that wrote it did.

#include "results/saved_calibration.hpp"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "base/json_tree.hpp"
#include "base/sha256.hpp"
#include "calibration/calibrate.hpp"
#include "calibration/calibration_settings.hpp"
#include "effects/effect_terms.hpp"
#include "planning/simulation.hpp"
#include "refusal.hpp"
#include "results/calibrated_urdf.hpp"
#include "results/result_json.hpp"
#include "virtual_experiment.hpp"

namespace kdl_calibration::saved_calibration_test {
namespace {

using Json = nlohmann::json;
using ::testing::HasSubstr;
using testing::kOddArm;

/// The odd arm with sagging joints, two targets of which one is a pose.
struct Written {
  Robot robot = parse_robot(kOddArm);
  Measurements measured;
  CalibrationSettings options{
      .parameters = {.fix = {"tables.1.*", "tables.2.*", "tables.4.*", "tables.5.*"}},
      .selection = {.effects = {.groups = {EffectGroup::gravity, EffectGroup::transverse, EffectGroup::backlash,
                                           EffectGroup::harmonics, EffectGroup::tables}}},
      .validation = {.held_out = false},
      .diagnosis = {.try_readings = false}};
  CalibrationResult calibration;
  std::string json;

  Written() {
    const ErrorModel model = complete_model(robot);
    std::vector<TargetFrame> targets = testing::targets_at({{0.1, 0.0, 0.05}, {0.0, 0.12, 0.0}});
    targets[1].with_orientation = true;
    targets[1].X_FT.linear() = Eigen::AngleAxisd(2.0, Eigen::Vector3d(1.0, 0.5, -0.3).normalized()).toRotationMatrix();
    testing::VirtualExperiment experiment({.model = model,
                                           .targets = targets,
                                           .X_WB = Eigen::Isometry3d(Eigen::Translation3d(2.0, 1.0, 0.5)),
                                           .random = Random(5)});
    VirtualRobot& arm = experiment.robot;
    arm.model.effects = load_terms(model);
    arm.truth.effects = Eigen::VectorXd::Constant(static_cast<Eigen::Index>(arm.model.effects.size()), 4e-4);
    measured = experiment.measure(40, {.sigma = 3e-5});
    calibration = calibrate(model, measured, options);
    json = result_json(robot, measured, calibration);
  }
};

const Written& written() {
  static const Written one;
  return one;
}

/// That parsing is refused, and its words.
std::string refusal(const std::string& json, const Robot& robot) {
  return testing::refusal([&] { parse_calibration(json, robot, "r.json"); });
}

/// The result with a change, and the hashes it was written with, new ones as a program could write, or none.
using Edit = std::function<void(Json&)>;
std::string edited(const Edit& edit) {
  Json json = Json::parse(written().json);
  edit(json);
  return json.dump();
}
std::string edited_and_hashed(const Edit& edit) {
  return edited([&](Json& json) {
    edit(json);
    json["hashes"] = tree::hashes(json);
  });
}
/// The members that version 0.1.0 wrote, with a change.
std::string of_first_version(const Edit& edit) {
  return edited([&](Json& json) {
    json["software"]["version"] = "0.1.0";
    for (const char* later : {"hashes", "remarks", "detectable", "assumed", "undetermined", "new_point"}) {
      json.erase(later);
    }
    edit(json);
  });
}

const std::string kTaken = "nothing was refused";

TEST(SavedCalibration, HasTheEstimateToTheLastBit) {
  const Estimate& wrote = written().calibration.fit.identification.estimate;
  const CalibrationParts read = parse_calibration(written().json, written().robot);
  EXPECT_TRUE(read.estimate.errors == wrote.errors);
  ASSERT_EQ(read.model.effects.size(), written().calibration.model.effects.size());
  ASSERT_GT(read.model.effects.size(), 2U);
  EXPECT_TRUE(read.estimate.effects == wrote.effects);
  EXPECT_TRUE(read.estimate.frames.base().translation() == wrote.frames.base().translation());
  EXPECT_LT((read.estimate.frames.base().linear() - wrote.frames.base().linear()).norm(), 1e-14);
  ASSERT_EQ(read.estimate.frames.targets.size(), 2U);
  for (std::size_t k = 0; k < 2; ++k) {
    EXPECT_EQ(read.estimate.frames.targets[k].name, wrote.frames.targets[k].name);
    EXPECT_EQ(read.estimate.frames.targets[k].with_orientation, wrote.frames.targets[k].with_orientation);
    EXPECT_LT((read.estimate.frames.targets[k].X_FT.matrix() - wrote.frames.targets[k].X_FT.matrix()).norm(), 1e-14);
  }
  EXPECT_EQ(read.verdict, written().calibration.verdict());
  EXPECT_EQ(read.free.names(), written().calibration.fit.free.names());
  const Eigen::MatrixXd& C = written().calibration.uncertainty.covariance;
  ASSERT_EQ(read.covariance.rows(), C.rows());
  EXPECT_TRUE(read.covariance == Eigen::MatrixXd(C.selfadjointView<Eigen::Lower>()));
}

void expect_same(const std::vector<Doubt>& read, const std::vector<Doubt>& wrote) {
  ASSERT_EQ(read.size(), wrote.size());
  for (std::size_t i = 0; i < wrote.size(); ++i) {
    EXPECT_EQ(read[i].cause, wrote[i].cause) << wrote[i].message;
    EXPECT_EQ(read[i].subjects, wrote[i].subjects) << wrote[i].message;
    EXPECT_EQ(read[i].figures, wrote[i].figures) << wrote[i].message;
    EXPECT_EQ(read[i].message, wrote[i].message);
  }
}

TEST(SavedCalibration, KeepsDoubtsAndWhatIsNotDetermined) {
  CalibrationResult doubted = written().calibration;
  doubted.diagnosis.doubts = {{.cause = Cause::not_converged,
                               .subjects = {{SubjectKind::station, "S1"}, {SubjectKind::coordinate, "z"}},
                               .figures = {{"misfit", 0.1}, {"moves", std::numeric_limits<double>::infinity()}},
                               .message = "it moves"}};
  doubted.diagnosis.remarks = {{.cause = Cause::few_data, .figures = {{"degrees_of_freedom", 7.5}}, .message = "few"},
                               {.cause = Cause::held_by_gauge,
                                .subjects = subjects_named(SubjectKind::parameter, {"dq1", "A.x"}),
                                .message = "held"}};
  doubted.uncertainty.covariance(3, 3) = std::numeric_limits<double>::infinity();
  const CalibrationParts read =
      parse_calibration(result_json(written().robot, written().measured, doubted), written().robot);
  EXPECT_EQ(read.verdict, Verdict::not_trusted);
  expect_same(read.doubts, doubted.diagnosis.doubts);
  expect_same(read.remarks, doubted.diagnosis.remarks);
  EXPECT_EQ(read.warnings, (std::vector<std::string>{"few", "held"}));
  EXPECT_TRUE(std::isinf(read.covariance(3, 3)));
  EXPECT_TRUE(std::isfinite(read.covariance(4, 4)));
}

TEST(SavedCalibration, OfAnEarlierVersionStatesNoCausesOfItsWarnings) {
  const std::string earlier = of_first_version([](Json& r) {
    r["warnings"] = Json::array({"one"});
    r["trusted"] = false;
    r["doubts"] = Json::array({Json{{"cause", "drift"}, {"message", "b"}}});
  });
  const CalibrationParts read = parse_calibration(earlier, written().robot);
  EXPECT_EQ(read.warnings, std::vector<std::string>{"one"});
  EXPECT_TRUE(read.remarks.empty());
  expect_same(read.doubts, {{.cause = Cause::drift, .message = "b"}});
}

TEST(SavedCalibration, WithRemarksOrFiguresThatNobodyWritesIsRefused) {
  const auto fault = [](const Json& remark) {
    return refusal(edited_and_hashed([&](Json& r) {
                     r["warnings"] = Json::array({"one"});
                     r["remarks"] = Json::array({remark});
                   }),
                   written().robot);
  };
  const Json sound = {{"cause", "few_data"}, {"subjects", Json::array()}, {"figures", {{"degrees_of_freedom", 1e300}}}};
  const auto with = [&](const char* key, const Json& value) {
    Json remark = sound;
    remark[key] = value;
    return fault(remark);
  };
  EXPECT_EQ(fault(sound), kTaken);
  EXPECT_THAT(with("cause", "bad luck"), HasSubstr("r.json: remarks[0]: cause: 'bad luck' is unknown"));
  EXPECT_EQ(with("subjects", Json::array({Json{{"kind", "robot"}, {"name", "R1"}}})),
            "r.json: remarks[0]: subjects[0]: kind: expected a kind of subject that calibrate writes");
  EXPECT_EQ(with("figures", Json::object({{"misfit", "large"}})),
            "r.json: remarks[0]: figures: misfit: expected a number or null");
  EXPECT_EQ(refusal(edited_and_hashed([&](Json& r) {
                      r["warnings"] = Json::array({"one", "two"});
                      r["remarks"] = Json::array({sound});
                    }),
                    written().robot),
            "r.json: remarks: expected one for each warning");
}

TEST(SavedCalibration, KeepsTheNoiseOfATracker) {
  CalibrationResult result = written().calibration;
  result.noise.independent.setZero();
  result.noise.tracker = TrackerNoise{1e-5, 2e-6, 3e-5, 4e-6};
  const CalibrationParts read =
      parse_calibration(result_json(written().robot, written().measured, result), written().robot);
  ASSERT_TRUE(read.noise.model.tracker);
  EXPECT_EQ(read.noise.model.tracker->range, 1e-5);
  EXPECT_EQ(read.noise.model.tracker->range_per_metre, 2e-6);
  EXPECT_EQ(read.noise.model.tracker->transverse, 3e-5);
  EXPECT_EQ(read.noise.model.tracker->transverse_per_metre, 4e-6);
}

// The errors would be applied twice.
TEST(SavedCalibration, OfAnotherUrdfIsRefused) {
  const Robot corrected = parse_robot(calibrated_urdf(written().robot, written().calibration), {}, "calibrated.urdf");
  EXPECT_THAT(refusal(written().json, corrected), HasSubstr("r.json: was not made with calibrated.urdf: its hash"));
  const Robot shorter = parse_robot(kOddArm, {.base = {}, .tip = "e"});
  EXPECT_THAT(refusal(written().json, shorter),
              HasSubstr("r.json: input: tip is 'tool', expected that of this robot, 'e'"));
  EXPECT_THAT(refusal(written().json, parse_robot(kOddArm, {.base = "a", .tip = {}})),
              HasSubstr("r.json: input: base is 'world', expected that of this robot, 'a'"));
}

TEST(SavedCalibration, NeedsNothingButParameters) {
  const CalibrationParts read =
      parse_calibration(R"({"parameters": [{"name": "dq2", "error": 0.002}]})", written().robot);
  EXPECT_EQ(read.estimate.errors.sum(), 0.002);
  EXPECT_EQ(read.verdict, Verdict::not_trusted);
  EXPECT_EQ(read.covariance.size(), 0);
  EXPECT_THAT(refusal(R"({"parameters": [{"name": "dq9", "error": 0.002}]})", written().robot),
              HasSubstr("r.json: parameters[0]: this robot has no parameter 'dq9'"));
  EXPECT_THAT(refusal(R"({"parameters": [{"name": "dq2"}]})", written().robot), HasSubstr("\"error\" is missing"));
  EXPECT_THAT(refusal("{}", written().robot), HasSubstr("\"parameters\" is missing"));
}

// The covariance as version 0.1 wrote it.
void to_triangle(Json& covariance) {
  covariance["lower_triangle"] = covariance["matrix"];
  for (std::size_t r = 0; r < covariance["names"].size(); ++r) {
    Json& row = covariance["lower_triangle"][r];
    row.erase(row.begin() + static_cast<std::ptrdiff_t>(r) + 1, row.end());
  }
  covariance.erase("matrix");
}

TEST(SavedCalibration, WithACovarianceThatFitsNothingIsRefused) {
  const auto spoilt = [](const Edit& spoil) {
    return refusal(edited_and_hashed([&](Json& json) { spoil(json["covariance"]); }), written().robot);
  };
  EXPECT_THAT(spoilt([](Json& c) { std::swap(c["names"][0], c["names"][1]); }), HasSubstr("names: expected"));
  EXPECT_THAT(spoilt([](Json& c) { c["matrix"].erase(0); }), HasSubstr("a row for each name"));
  EXPECT_THAT(spoilt([](Json& c) { c["matrix"][2].push_back(1.0); }), HasSubstr("matrix[2]: expected "));
  EXPECT_THAT(spoilt([](Json& c) { c["matrix"][2][1] = "x"; }), HasSubstr("matrix[2][1]: expected"));
  EXPECT_THAT(spoilt([](Json& c) { c["matrix"][2][1] = 1.0; }),
              HasSubstr("matrix[2][1]: expected the number of row 1, column 2"));
  EXPECT_THAT(spoilt([](Json& c) {
                to_triangle(c);
                c["lower_triangle"][2].push_back(1.0);
              }),
              HasSubstr("lower_triangle[2]: expected 3"));
}

TEST(SavedCalibration, OfAnEarlierVersionHoldsTheSameCovarianceAsATriangle) {
  const std::string earlier = of_first_version([](Json& json) { to_triangle(json["covariance"]); });
  const Eigen::MatrixXd covariance = parse_calibration(earlier, written().robot).covariance;
  ASSERT_GT(covariance.size(), 0);
  EXPECT_EQ(covariance, parse_calibration(written().json, written().robot).covariance);
}

std::size_t index_of(const Json& parameters, const std::string& name) {
  std::size_t i = 0;
  while (parameters.at(i)["name"] != name) {
    ++i;
  }
  return i;
}

TEST(SavedCalibration, ThatWasEditedIsRefusedWithTheField) {
  const Json doubt = {{"cause", "a"}, {"message", "b"}};
  const std::vector<std::pair<std::string, Edit>> edits = {
      {"parameters", [](Json& r) { r["parameters"].erase(index_of(r["parameters"], "dq2")); }},
      {"parameters", [](Json& r) { r["parameters"].push_back(r["parameters"][index_of(r["parameters"], "dq2")]); }},
      {"parameters", [](Json& r) { r["parameters"][7]["error"] = -r["parameters"][7]["error"].get<double>(); }},
      {"parameters", [](Json& r) { r["parameters"][7]["value"] = 1.0; }},
      {"effects",
       [](Json& r) {
         r["effects"]["gravity_direction"] = Json::array({0, 0, 0});
       }},
      {"covariance", [](Json& r) { r["covariance"]["matrix"][3][3] = -1e-9; }},
      {"covariance", [](Json& r) { r.erase("covariance"); }},
      {"base", [](Json& r) { r["base"]["position"][0] = 2.0; }},
      {"targets", [](Json& r) { std::swap(r["targets"][0], r["targets"][1]); }},
      {"trusted", [](Json& r) { r["trusted"] = !r["trusted"]; }},
      {"doubts", [&](Json& r) { r["doubts"].push_back(doubt); }},
      {"reservation", [&](Json& r) { r["reservation"] = doubt; }},
      {"input", [](Json& r) { r["input"].erase("sha256"); }},
      {"noise", [](Json& r) { r["noise"]["sigma"] = 1e-9; }},
      {"software", [](Json& r) { r["software"]["version"] = "0.0.1"; }},
      {"software", [](Json& r) { r["software"]["version"] = "0.1.0"; }},
      {"doubts", [](Json& r) { r["hashes"].erase("doubts"); }},
      {"hashes", [](Json& r) { r["hashes"].erase("hashes"); }},
      {"hashes",
       [](Json& r) {
         r.erase("doubts");
         r["hashes"].erase("doubts");
       }},
      {"hashes", [&](Json& r) {
         r["reservation"] = doubt;
         r["hashes"]["reservation"] = tree::hashes(r)["reservation"];
       }}};
  for (const auto& [field, edit] : edits) {
    EXPECT_EQ(refusal(edited(edit), written().robot),
              "r.json: " + field + ": was changed after calibrate wrote the file, expected the original (only " +
                  "provenance may be edited)");
  }
  EXPECT_EQ(refusal(edited([](Json& r) { r["hashes"] = "x"; }), written().robot), "r.json: hashes: expected an object");
}

TEST(SavedCalibration, OfALaterVersionHasHashes) {
  const auto of_version = [](const Json& version) {
    return refusal(of_first_version([&](Json& r) { r["software"]["version"] = version; }), written().robot);
  };
  EXPECT_EQ(of_version("0.1.0"), kTaken);
  const std::string missing = "r.json: the key \"hashes\" is missing, expected the file as calibrate wrote it";
  for (const Json& version : {Json("0.1.1"), Json("0.2.0"), Json("1.0.0"), Json(""), Json(nullptr), Json(1)}) {
    EXPECT_EQ(of_version(version), missing) << version;
  }
  EXPECT_EQ(refusal(edited([](Json& r) { r.erase("hashes"); }), written().robot), missing);
  // A verdict alone makes it a result.
  for (const char* kept : {"trusted", "doubts", "software"}) {
    EXPECT_EQ(refusal(of_first_version([&](Json& r) {
                        r["software"]["version"] = "0.2.0";
                        for (const char* each : {"trusted", "doubts", "software"}) {
                          if (std::string(kept) != each) {
                            r.erase(each);
                          }
                        }
                      }),
                      written().robot),
              missing)
        << kept;
  }
}

TEST(SavedCalibration, OfTheFirstVersionHoldsNothingOfLaterOnes) {
  const Json json = Json::parse(written().json);
  for (const char* later : {"remarks", "detectable", "assumed", "stations", "prior_result", "undetermined"}) {
    EXPECT_EQ(refusal(of_first_version([&](Json& r) { r[later] = json.value(later, Json()); }), written().robot),
              std::string("r.json: ") + later +
                  ": was not written by version 0.1.0, expected the file as calibrate wrote it");
  }
}

TEST(SavedCalibration, WithoutHashesIsNeverTrusted) {
  const std::string trusted = of_first_version([](Json& r) {
    r["trusted"] = true;
    r["doubts"] = Json::array();
    r["warnings"] = Json::array({"one"});
  });
  const CalibrationParts read = parse_calibration(trusted, written().robot);
  EXPECT_EQ(read.verdict, Verdict::not_trusted);
  ASSERT_EQ(read.warnings.size(), 2U);
  EXPECT_EQ(read.warnings[0], "one");
  EXPECT_THAT(read.warnings[1], HasSubstr("nothing shows whether the file was edited"));
}

// What jq, Python and browsers make of a file: keys in another order, no indentation, 1.0 as 1 and -0.0 as 0.
void spell_otherwise(Json& value) {
  if (value.is_structured()) {
    std::for_each(value.begin(), value.end(), spell_otherwise);
  } else if (value.is_number_float() && value == std::floor(value.get<double>())) {
    value = static_cast<std::int64_t>(value.get<double>());
  }
}

TEST(SavedCalibration, IsReadHoweverItIsSpeltAndAnnotated) {
  EXPECT_EQ(refusal(edited(spell_otherwise), written().robot), kTaken);
  EXPECT_EQ(refusal(edited([](Json& r) { r["provenance"]["notes"]["serial"] = "7"; }), written().robot), kTaken);
  EXPECT_EQ(refusal(edited([](Json& r) { r.erase("provenance"); }), written().robot), kTaken);
}

// By hand, as RFC 8785 has it but for the numbers: those as nlohmann/json prints a double.
TEST(SavedCalibration, HashesAreOfSortedCompactJson) {
  const Json hashes = tree::hashes(tree::Json::parse(
      R"({"b": [1, -0.0, 2.5E-5, true, null], "a": {"z": "\u00fc", "c": 18014398509481984}, "provenance": 1, "hashes": 2})"));
  const std::string a = sha256("{\"c\":1.8014398509481984e+16,\"z\":\"\xc3\xbc\"}");
  const std::string b = sha256("[1.0,0.0,2.5e-05,true,null]");
  EXPECT_EQ(hashes, (Json{{"b", b}, {"a", a}, {"hashes", sha256("{\"a\":\"" + a + "\",\"b\":\"" + b + "\"}")}}));
}

TEST(SavedCalibration, WithoutHashesAgreesWithItself) {
  const auto faults = [](const Edit& edit) { return refusal(of_first_version(edit), written().robot); };
  const auto parameter = [](Json& r, const std::string& name) -> Json& {
    return r["parameters"][index_of(r["parameters"], name)];
  };
  EXPECT_EQ(faults([](Json&) {}), kTaken);
  EXPECT_THAT(faults([&](Json& r) { r["parameters"].push_back(parameter(r, "dq2")); }),
              HasSubstr("]: parameter 'dq2' is there twice, expected each once"));
  EXPECT_THAT(faults([&](Json& r) { parameter(r, "dq2")["error"] = 0.1; }),
              HasSubstr("]: value: expected the sum of \"nominal\" and \"error\""));
  const auto turned = [&](double angle) {
    return faults([&](Json& r) {
      parameter(r, "dq3")["error"] = angle;
      parameter(r, "dq3")["value"] = parameter(r, "dq3")["nominal"].get<double>() + angle;
    });
  };
  EXPECT_EQ(turned(-6.2), kTaken);
  EXPECT_THAT(turned(-100.0), HasSubstr("]: error: expected an angle of at most a turn, in radians"));
  EXPECT_EQ(faults([](Json& r) {
              r["effects"]["gravity_direction"] = Json::array({0, 0, 0});
            }),
            "r.json: effects: gravity_direction: expected a direction of norm 1");
  EXPECT_EQ(faults([](Json& r) { r["covariance"]["matrix"][3][3] = -1e-9; }),
            "r.json: covariance: matrix[3][3]: expected a variance, 0 or more");
  EXPECT_EQ(faults([](Json& r) {
              r["trusted"] = true;
              r["doubts"] = Json::array({Json{{"cause", "drift"}, {"message", "b"}}});
            }),
            "r.json: trusted: expected false, as there are doubts");
}

// Files are read up to 64 MiB.
TEST(SavedCalibrationLongRun, OfNineHundredThousandRowsIsRead) {
  Written many = written();
  const std::vector<Observation> once = many.measured.observations;
  for (std::size_t row = once.size(); row < 900000; ++row) {
    many.measured.observations.push_back(once[row % once.size()]);
  }
  many.calibration.fit.robust.weights.assign(900000, 0.12345678901234567);
  const std::filesystem::path file = std::filesystem::temp_directory_path() / "kdl_calibration_saved_test.json";
  std::ofstream(file, std::ios::binary) << result_json(many.robot, many.measured, many.calibration);
  const CalibrationParts read = read_calibration(file, many.robot);
  std::filesystem::remove(file);
  EXPECT_TRUE(read.estimate.errors == many.calibration.fit.identification.estimate.errors);
}

// Written by hand, so that nothing is the identity.
TEST(SavedCalibration, ReadsBaseTargetsAndGravityAsTheyStand) {
  Json json = Json::parse(R"({"parameters": [{"name": "dq2", "error": 0.002}, {"name": "base.Tx"}],
      "base": {"position": [1.0, 2.0, 3.0], "quaternion_wxyz": [0.5, 0.5, 0.5, 0.5]},
      "targets": [{"name": "A", "position": [0.1, 0.2, 0.3]},
                  {"name": "B", "position": [0.4, 0.5, 0.6], "quaternion_wxyz": [0.5, -0.5, 0.5, 0.5]}],
      "effects": {"gravity_direction": [0.6, 0.0, -0.8], "terms": []},
      "covariance": null, "trusted": true, "doubts": []})");
  const auto read = [&] {
    json["hashes"] = tree::hashes(json);
    return parse_calibration(json.dump(), written().robot);
  };
  const CalibrationParts saved = read();
  const Eigen::Vector3d turned = saved.estimate.frames.base().linear() * Eigen::Vector3d(1.0, 2.0, 3.0);
  EXPECT_LT((turned - Eigen::Vector3d(3.0, 1.0, 2.0)).norm(), 1e-12);  // x to y to z
  EXPECT_EQ(saved.estimate.frames.base().translation(), Eigen::Vector3d(1.0, 2.0, 3.0));
  ASSERT_EQ(saved.estimate.frames.targets.size(), 2U);
  EXPECT_FALSE(saved.estimate.frames.targets[0].with_orientation);
  EXPECT_EQ(saved.estimate.frames.targets[1].name, "B");
  EXPECT_EQ(saved.estimate.frames.targets[1].X_FT.translation(), Eigen::Vector3d(0.4, 0.5, 0.6));
  EXPECT_TRUE(saved.estimate.frames.targets[1].X_FT.linear().isApprox(
      Eigen::Quaterniond(0.5, -0.5, 0.5, 0.5).toRotationMatrix(), 1e-12));
  EXPECT_EQ(saved.model.gravity, KDL::Vector(0.6, 0.0, -0.8));
  EXPECT_EQ(saved.model.effects.size(), 0U);
  EXPECT_EQ(saved.estimate.errors.sum(), 0.002);
  EXPECT_EQ(saved.covariance.size(), 0);
  EXPECT_NE(saved.verdict, Verdict::not_trusted);
  EXPECT_TRUE(saved.doubts.empty());
  json["trusted"] = false;
  EXPECT_EQ(read().verdict, Verdict::not_trusted);
}

}  // namespace
}  // namespace kdl_calibration::saved_calibration_test
