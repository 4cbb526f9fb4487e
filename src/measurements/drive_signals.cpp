#include "measurements/drive_signals.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "base/text.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;

const char* to_string(Circumstance circumstance) {
  return circumstance == Circumstance::temperature ? "temperature" : "payload";
}

namespace {

// Of values that are not NaN. `row` has an element for each configuration, or none.
template <class Row>
CircumstanceRange range_of_row(const Row& row, const std::vector<bool>& which) {
  CircumstanceRange range;
  double sum = 0.0;
  double count = 0.0;
  for (Index c = 0; c < row.size(); ++c) {
    const double value = row[c];
    if (which[static_cast<std::size_t>(c)] && !std::isnan(value)) {
      range.lower = std::fmin(range.lower, value);
      range.upper = std::fmax(range.upper, value);
      sum += value;
      count += 1.0;
    }
  }
  range.mean = sum / count;  // NaN if none is known
  return range;
}

bool is_any_known(const MatrixXd& values, Index row) { return !values.row(row).array().isNaN().all(); }

}  // namespace

CircumstanceRange range_of(const DriveSignals& signals, Circumstance circumstance, const std::vector<bool>& which) {
  return signals.circumstances.size() == 0
             ? CircumstanceRange()
             : range_of_row(signals.circumstances.row(static_cast<Index>(circumstance)), which);
}

CircumstanceRange range_of_link(const DriveSignals& signals, Index link, const std::vector<bool>& which) {
  return range_of_row(signals.link_temperatures.row(link), which);
}

bool is_stated(const DriveSignals& signals, Circumstance circumstance) {
  return signals.circumstances.size() > 0 && is_any_known(signals.circumstances, static_cast<Index>(circumstance));
}

bool is_stated_of_any_link(const DriveSignals& signals, Circumstance circumstance) {
  return is_stated(signals, circumstance) ||
         (circumstance == Circumstance::temperature && !signals.link_temperatures.array().isNaN().all());
}

std::optional<Index> row_of_link(const DriveSignals& signals, const std::vector<std::string>& links) {
  for (std::size_t row = 0; row < signals.links.size(); ++row) {
    if (std::find(links.begin(), links.end(), signals.links[row]) != links.end() &&
        is_any_known(signals.link_temperatures, static_cast<Index>(row))) {
      return static_cast<Index>(row);
    }
  }
  return std::nullopt;
}

bool has_temperature(const DriveSignals& signals, const std::vector<std::string>& links) {
  return is_stated(signals, Circumstance::temperature) || row_of_link(signals, links).has_value();
}

std::string fault_of_links(const std::vector<std::string>& named, const std::vector<std::string>& known,
                           const std::vector<MovingJoint>& joints) {
  const auto is_among = [](const std::string& name, const std::vector<std::string>& names) {
    return std::find(names.begin(), names.end(), name) != names.end();
  };
  for (const std::string& name : named) {
    if (!known.empty() && !is_among(name, known)) {
      return "temperature of " + shown(name) + ", which is no link of the chain: expected some of " +
             comma_separated(known);
    }
  }
  for (const MovingJoint& joint : joints) {
    std::string first;
    for (const std::string& name : named) {
      if (is_among(name, joint.links) && !first.empty()) {
        return "temperatures of " + shown(first) + " and " + shown(name) +
               ", which are fixed to each other: expected that of one of them";
      }
      first = is_among(name, joint.links) ? name : first;
    }
  }
  return {};
}

bool has_torques(const DriveSignals& signals, Index joint) {
  return signals.torques.size() > 0 && !signals.torques.row(joint).array().isNaN().all();
}

std::pair<double, double> possible_range(Circumstance circumstance) {
  return circumstance == Circumstance::temperature ? std::pair{-273.15, 1000.0} : std::pair{0.0, 1e5};
}

namespace {

std::string fault_of_range(const std::string& name, const std::string& what, std::pair<double, double> possible) {
  return "an impossible " + name + what +
         fmt::format(", expected {} to {} and NaN where none is known", possible.first, possible.second);
}

std::string fault_of_link_temperatures(const DriveSignals& signals, Index configurations, const std::string& what) {
  const MatrixXd& stated = signals.link_temperatures;
  const auto possible = possible_range(Circumstance::temperature);
  if (stated.rows() != std::ssize(signals.links) || (!signals.links.empty() && stated.cols() != configurations)) {
    return fmt::format("{} x {} temperatures of links{}, expected {} x {}, one of each link for each configuration",
                       stated.rows(), stated.cols(), what, signals.links.size(), configurations);
  }
  for (std::size_t row = 0; row < signals.links.size(); ++row) {
    const auto values = stated.row(static_cast<Index>(row)).array();
    if ((values < possible.first).any() || (values > possible.second).any()) {
      return fault_of_range("temperature of " + shown(signals.links[row]), what, possible);
    }
    if (std::count(signals.links.begin(), signals.links.end(), signals.links[row]) > 1) {
      return "temperatures of " + shown(signals.links[row]) + what + " are there twice, expected each link once";
    }
  }
  return {};
}

}  // namespace

std::string fault_of(const DriveSignals& signals, const MatrixXd& joint_values, const std::string& what) {
  const auto size = [](const MatrixXd& matrix) { return fmt::format("{} x {}", matrix.rows(), matrix.cols()); };
  for (const auto& [name, values] :
       {std::pair{"directions of approach", &signals.approach}, std::pair{"torques", &signals.torques}}) {
    if (values->size() == 0) {
      continue;
    }
    if (values->rows() != joint_values.rows() || values->cols() != joint_values.cols()) {
      return size(*values) + " " + name + what + ", expected " + size(joint_values) + ", one for each joint value";
    }
    if (values->array().isInf().any()) {
      return std::string(name) + what + " that are infinite, expected NaN where none is known";
    }
  }
  const MatrixXd& around = signals.circumstances;
  if (around.size() > 0 && (around.rows() != kCircumstances || around.cols() != joint_values.cols())) {
    return size(around) + " circumstances" + what + ", expected 2 x " + std::to_string(joint_values.cols()) +
           ", temperature and payload of each configuration";
  }
  for (Index row = 0; row < around.rows(); ++row) {
    const auto circumstance = static_cast<Circumstance>(row);
    const auto possible = possible_range(circumstance);
    if ((around.row(row).array() < possible.first).any() || (around.row(row).array() > possible.second).any()) {
      return fault_of_range(to_string(circumstance), what, possible);
    }
  }
  return fault_of_link_temperatures(signals, joint_values.cols(), what);
}

DriveSignals columns(const DriveSignals& signals, const std::vector<Index>& which) {
  const auto of = [&](const MatrixXd& matrix) {
    return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix(Eigen::all, which));
  };
  return {.approach = of(signals.approach),
          .torques = of(signals.torques),
          .circumstances = of(signals.circumstances),
          .links = signals.links,
          .link_temperatures = of(signals.link_temperatures)};
}

DriveSignals column(const DriveSignals& signals, Index which) {
  const auto of = [&](const MatrixXd& matrix) { return matrix.size() == 0 ? MatrixXd() : MatrixXd(matrix.col(which)); };
  return {.approach = of(signals.approach),
          .torques = of(signals.torques),
          .circumstances = of(signals.circumstances),
          .links = signals.links,
          .link_temperatures = of(signals.link_temperatures)};
}

DriveSignals side_by_side(const DriveSignals& first, const DriveSignals& second) {
  const auto both = [](const MatrixXd& left, const MatrixXd& right) {
    MatrixXd result;
    if (left.size() > 0 && right.size() > 0) {
      result.resize(left.rows(), left.cols() + right.cols());
      result << left, right;
    }
    return result;
  };
  DriveSignals result = {.approach = both(first.approach, second.approach),
                         .torques = both(first.torques, second.torques),
                         .circumstances = both(first.circumstances, second.circumstances)};
  std::vector<Index> of_first;
  std::vector<Index> of_second;
  for (std::size_t row = 0; row < first.links.size(); ++row) {
    const auto same = std::find(second.links.begin(), second.links.end(), first.links[row]);
    if (same != second.links.end()) {
      of_first.push_back(static_cast<Index>(row));
      of_second.push_back(same - second.links.begin());
      result.links.push_back(first.links[row]);
    }
  }
  result.link_temperatures =
      both(first.link_temperatures(of_first, Eigen::all), second.link_temperatures(of_second, Eigen::all));
  return result;
}

MatrixXd directions_of_motion(const MatrixXd& stops) {
  constexpr double kLeastMotion = 1e-6;  // [rad or m]
  MatrixXd result = MatrixXd::Constant(stops.rows(), stops.cols(), std::numeric_limits<double>::quiet_NaN());
  for (Index c = 1; c < stops.cols(); ++c) {
    for (Index j = 0; j < stops.rows(); ++j) {
      const double motion = stops(j, c) - stops(j, c - 1);
      result(j, c) = std::abs(motion) > kLeastMotion ? std::copysign(1.0, motion) : result(j, c - 1);
    }
  }
  return result;
}

}  // namespace kdl_calibration
