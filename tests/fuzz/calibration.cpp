#include "calibration/calibrate.hpp"
#include "kdl_calibration/measurements.hpp"
#include "results/calibrated_urdf.hpp"

#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "calibration/calibration_settings.hpp"
#include "kdl_calibration/noise_model.hpp"
#include "planning/simulation.hpp"
#include "promise.hpp"
#include "results/result_json.hpp"
#include "results/result_table.hpp"
#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

/// Takes numbers from the bytes, zeros behind their end.
class Reader {
public:
  explicit Reader(std::string_view bytes) : bytes_(bytes) {}

  bool empty() const { return bytes_.empty(); }

  unsigned byte() {
    if (bytes_.empty()) {
      return 0;
    }
    const auto value = static_cast<unsigned char>(bytes_.front());
    bytes_.remove_prefix(1);
    return value;
  }

  /// Small ones, special ones and any other that a file may hold.
  double number() {
    constexpr std::array<double, 12> kSpecial = {0.0,    -0.0, 1.0,   -1.0,  1e-9,  1e6,
                                                 1e-300, 1e12, 1e100, 1e300, 1e-12, 1.5707963267948966};
    const unsigned kind = byte();
    if (kind < kSpecial.size()) {
      return kSpecial.at(kind);
    }
    if (kind < 200) {
      return (static_cast<double>(byte() + 256 * byte()) - 32768.0) / 8192.0;
    }
    std::array<unsigned char, sizeof(double)> raw{};
    for (unsigned char& b : raw) {
      b = static_cast<unsigned char>(byte());
    }
    double value = 0.0;
    std::memcpy(&value, raw.data(), sizeof value);
    return std::isfinite(value) ? value : 0.0;
  }

private:
  std::string_view bytes_;
};

std::string urdf_text(const std::array<double, 9>& n) {
  const auto triple = [&](std::size_t i) {
    return nlohmann::json(n[i]).dump() + " " + nlohmann::json(n[i + 1]).dump() + " " + nlohmann::json(n[i + 2]).dump();
  };
  return "<robot name='r'><link name='a'/><link name='b'/><link name='c'/><link name='d'/>"
         "<joint name='j1' type='continuous'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/><origin xyz='" +
         triple(0) +
         "'/></joint><joint name='j2' type='revolute'><parent link='b'/><child link='c'/><axis xyz='1 0 0'/>"
         "<limit lower='-3' upper='3' velocity='1' effort='1'/><origin xyz='" +
         triple(3) + "' rpy='" + triple(6) +
         "'/></joint><joint name='tool' type='fixed'><parent link='c'/><child link='d'/><origin xyz='0 0.4 0'/>"
         "</joint></robot>";
}

constexpr std::array<double, 9> kOrigins = {0.1, 0.0, 0.5, 0.3, 0.2, 0.1, 0.0, 0.4, 0.0};

/// Two targets in eight configurations, the last one held out, each measured twice.
Measurements measured(const Robot& robot) {
  const ErrorModel model = complete_model(robot);
  Measurements m;
  m.source = "m.csv";
  m.joints = joint_names(robot);
  m.targets = {"A", "B"};
  m.joint_values.resize(2, 8);
  for (int c = 0; c < 8; ++c) {
    m.configurations.push_back(std::to_string(c));
    m.joint_values.col(c) << 0.7 * c - 2.0, 1.3 * std::sin(2.0 * c);
    for (int k = 0; k < 4; ++k) {
      const double tool = k % 2 == 0 ? 0.1 : -0.2;
      const double yaw = m.joint_values(0, c);
      Observation o{.reading = Point{{2.0 + std::cos(yaw) * (0.5 + tool), std::sin(yaw) + 1e-4 * k,
                                      1.0 + std::sin(m.joint_values(1, c)) * (0.4 - tool)}},
                    .configuration = c,
                    .target = k % 2,
                    .repeat = 1 + k / 2};
      o.split = c == 7 ? Split::test : Split::train;
      m.observations.push_back(o);
    }
  }
  return m;
}

CalibrationSettings options_from(Reader& reader) {
  constexpr std::array kLosses = {Loss::none, Loss::huber, Loss::tukey};
  const unsigned first = reader.byte();
  const unsigned second = reader.byte();
  CalibrationSettings options;
  options.threads = 1;
  options.estimator.iterations = 20;
  options.estimator.method = (first & 1U) != 0 ? Method::two_step : Method::joint;
  options.parameters.model = (first & 2U) != 0 ? ModelChoice::complete : ModelChoice::irreducible;
  options.estimator.loss = kLosses.at((first >> 2U) % kLosses.size());
  if ((first & 64U) != 0) {
    options.selection.effects.groups = (first & 32U) != 0 ? std::vector{EffectGroup::transverse, EffectGroup::ripple}
                                                          : std::vector{EffectGroup::gravity, EffectGroup::tables};
  }
  options.selection.effects.automatic = (first & 128U) != 0;
  options.validation.leave_one_out = (second & 7U) == 1;
  options.validation.k_fold = (second & 7U) == 2 ? 3 : 0;
  options.noise.weights = (second & 8U) != 0 ? Weights::repeats : Weights::automatic;
  options.selection.automatic_priors = (second & 0xf0U) == 0xf0U;
  if ((second & 16U) != 0) {
    options.parameters.fix = {"dq*", "?x1"};
  }
  if ((second & 32U) != 0) {
    options.selection.priors = {.length = std::abs(reader.number()), .angle = std::abs(reader.number())};
  }
  return options;
}

void change(Reader& reader, Measurements& m) {
  const unsigned what = reader.byte();
  const std::size_t row = reader.byte() % m.observations.size();
  Observation& o = m.observations[row];
  switch (what % 5) {
    case 0:
      m.joint_values(static_cast<Eigen::Index>(row % 2), static_cast<Eigen::Index>(row % 8)) = reader.number();
      break;
    case 1:
      o.position()[static_cast<Eigen::Index>(row % 3)] = reader.number();
      break;
    case 2:
      o.sigma = std::abs(reader.number());
      break;
    case 3:  // a configuration like another one
      m.joint_values.col(static_cast<Eigen::Index>(row % 8)) = m.joint_values.col(reader.byte() % 8);
      break;
    default:  // everything that much larger or smaller
      const double factor = reader.number();
      for (Observation& every : m.observations) {
        every.position() = (factor * every.position()).cwiseMax(-1e12).cwiseMin(1e12);
      }
  }
}

void check_numbers(const nlohmann::json& result, bool trusted) {
  for (const auto& parameter : result.at("parameters")) {
    promise((parameter.at("value").is_number() && parameter.at("error").is_number()) || !trusted,
            "parameters are numbers");
  }
  for (const auto& coordinate : result.at("base").at("position")) {
    promise(coordinate.is_number() || !trusted, "the base is made of numbers");
  }
  promise(result.at("position_error").at("train").at("after").at("rms").is_number() || !trusted, "an error");
}

}  // namespace

void calibration(std::string_view bytes) {
  Reader reader(bytes);
  const CalibrationSettings options = options_from(reader);
  std::array<double, 9> origins = kOrigins;
  for (unsigned changes = reader.byte() % 4; changes > 0; --changes) {
    const std::size_t which = reader.byte() % origins.size();
    origins.at(which) = reader.number();
  }
  let_input_errors_pass([&] {
    const Robot robot = parse_robot(urdf_text(origins));
    const ErrorModel model = complete_model(robot);
    Measurements m = measured(robot);
    for (int changes = 0; changes < 16 && !reader.empty(); ++changes) {
      change(reader, m);
    }
    m = parse_measurements(measurements_csv(m), m.joints);  // which refuses what is out of range
    const CalibrationResult found = calibrate(model, m, options);
    check_numbers(nlohmann::json::parse(result_json(robot, m, found)), found.trusted());
    promise(result_table(m, found).find("nan") == std::string::npos || !found.trusted(), "no nan in the table");
    const std::string text = calibrated_urdf(robot, model, found.exported.estimate.errors);
    promise(text.find("nan") == std::string::npos && text.find("inf") == std::string::npos, "a finite URDF");
    promise(parse_robot(text).joints.size() == 2, "a URDF");
  });
}

}  // namespace kdl_calibration::fuzzing
