#include "planning/places_plan.hpp"

#include <fmt/core.h>
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <mutex>
#include <string>
#include <utility>

#include "base/parallel.hpp"
#include "base/preconditions.hpp"
#include "base/text.hpp"
#include "estimation/least_squares.hpp"
#include "kdl_calibration/input_error.hpp"
#include "measurements/stations.hpp"
#include "planning/cell_constraints.hpp"
#include "planning/measuring_plan.hpp"
#include "selection/parameter_selection.hpp"

namespace kdl_calibration {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// A set of places, and the best configurations found at it.
struct Choice {
  PlacedRows rows;
  std::vector<MatrixXd> candidates;  // whitened rows of each, their columns scaled, those of the bases first
  std::vector<std::int16_t> stations;
  VectorXd scale;   // [m] or [rad] of the columns, so that those of all candidates have unit norm
  Index bases = 0;  // columns
  std::vector<std::size_t> members;
  double value = -std::numeric_limits<double>::infinity();  // log det M - log det M_b
};

double log_det(const MatrixXd& M) { return 2.0 * M.llt().matrixLLT().diagonal().array().log().sum(); }

MatrixXd inverse(const MatrixXd& M) { return M.llt().solve(MatrixXd::Identity(M.rows(), M.cols())); }

// M of these rows, and a little of each column, so that directions that no row shows stay finite and cancel.
MatrixXd information(const Choice& choice, const std::vector<std::size_t>& members) {
  constexpr double kRidge = 1e-9;
  MatrixXd M = kRidge * MatrixXd::Identity(choice.scale.size(), choice.scale.size());
  for (const std::size_t member : members) {
    M.noalias() += choice.candidates[member].transpose() * choice.candidates[member];
  }
  return M;
}

// What rows A add to log det M - log det M_b, for C = M^-1 and C_b = M_b^-1.
double gain(const MatrixXd& A, const MatrixXd& C, const MatrixXd& C_b) {
  const auto A_b = A.leftCols(C_b.cols());
  const MatrixXd unit = MatrixXd::Identity(A.rows(), A.rows());
  return log_det(unit + A * C * A.transpose()) - log_det(unit + A_b * C_b * A_b.transpose());
}

// Exchanges one member after another for the best candidate at the same station, until none is worth it.
void exchange(Choice& choice) {
  constexpr double kWorthWhile = 1e-6;
  constexpr int kMostPasses = 30;
  std::vector<bool> is_member(choice.candidates.size(), false);
  for (const std::size_t member : choice.members) {
    is_member[member] = true;
  }
  bool improved = true;
  for (int pass = 0; improved && pass < kMostPasses; ++pass) {
    improved = false;
    for (std::size_t& member : choice.members) {
      const MatrixXd& own = choice.candidates[member];
      const MatrixXd M = information(choice, choice.members) - own.transpose() * own;
      const MatrixXd C = inverse(M);
      const MatrixXd C_b = inverse(M.topLeftCorner(choice.bases, choice.bases));
      std::size_t best = member;
      double most = gain(own, C, C_b) + kWorthWhile;
      for (std::size_t i = 0; i < choice.candidates.size(); ++i) {
        if (is_member[i] || choice.stations[i] != choice.stations[member]) {
          continue;
        }
        if (const double here = gain(choice.candidates[i], C, C_b); here > most) {
          most = here;
          best = i;
        }
      }
      improved = improved || best != member;
      is_member[member] = false;
      is_member[best] = true;
      member = best;
    }
  }
  const MatrixXd M = information(choice, choice.members);
  choice.value = log_det(M) - log_det(M.topLeftCorner(choice.bases, choice.bases));
}

// The indices in the list that hold this station.
std::vector<std::size_t> indices_at_station(const std::vector<std::int16_t>& stations, std::size_t station) {
  std::vector<std::size_t> result;
  for (std::size_t i = 0; i < stations.size(); ++i) {
    if (static_cast<std::size_t>(stations[i]) == station) {
      result.push_back(i);
    }
  }
  return result;
}

// As many random candidates at each station.
std::vector<std::size_t> drawn(const Choice& choice, int count, Random& random) {
  const int stations = choice.stations.back() + 1;
  std::vector<std::size_t> result;
  for (int station = 0; station < stations; ++station) {
    std::vector<std::size_t> own = indices_at_station(choice.stations, static_cast<std::size_t>(station));
    const int wanted = count * (station + 1) / stations - count * station / stations;
    for (int k = 0; k < wanted; ++k) {
      const auto at = static_cast<std::size_t>(random.uniform() * static_cast<double>(own.size()));
      result.push_back(own[at]);
      own.erase(own.begin() + static_cast<std::ptrdiff_t>(at));
    }
  }
  return result;
}

// Candidates at places of their own.
PlacedRows candidate_rows(const PlanRequest& request, const Places& places, std::uint64_t start) {
  Random random(request.seed, start);
  const auto count = std::max<Index>(2L * request.count, request.candidates / request.starts);
  const VirtualRobot robot = nominal_robot(complete_model(request.robot), request.targets);
  Reach reach{.ranges = request.cell.ranges};
  if (places.sockets.empty()) {
    const Candidates drawn = candidates(request.robot, request.targets, request.cell,
                                        {.count = static_cast<int>(count), .seed = request.seed + start, .threads = 1});
    return rows_at(places, robot, reach, drawn.joint_values, random);
  }
  const CellConstraints constraints(request.robot, request.targets, request.cell);
  reach.allowed = [&](const VectorXd& q) { return constraints.violations(q) == 0; };
  return rows_at(places, robot, reach, MatrixXd::Zero(std::ssize(request.robot.joints), count), random);
}

Choice chosen(const PlanRequest& request, const Places& places, std::uint64_t start) {
  Choice choice{.rows = candidate_rows(request, places, start)};
  const auto& [robot, measurements] = choice.rows;
  const Unknowns free(robot.model, robot.truth.frames.targets,
                      select_parameters(robot.model, robot.truth.frames.targets, {}).free);
  choice.bases = free.range(UnknownGroup::base).count;
  choice.stations = stations_of_configurations(measurements);
  const WhitenedSystem system =
      LeastSquaresProblem(robot.model, measurements, free, {.noise = noise_model(request.noise)}).whitened(robot.truth);
  choice.scale = system.jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  for (std::size_t c = 0; c < measurements.configurations.size(); ++c) {
    const Index first = system.blocks[c];
    const Index end = c + 1 < system.blocks.size() ? system.blocks[c + 1] : system.jacobian.rows();
    choice.candidates.emplace_back(system.jacobian.middleRows(first, end - first) * choice.scale.asDiagonal());
  }
  Random random(request.seed, start);
  choice.members = drawn(choice, request.count, random);
  exchange(choice);
  return choice;
}

// The best of all sets of places. A set may fail; if all do, the first one's refusal counts.
Choice best_choice(const PlanRequest& request, const Places& places) {
  std::vector<Choice> choices(static_cast<std::size_t>(request.starts));
  std::vector<std::string> refusals(choices.size());
  std::mutex mutex;
  double done = 0.0;
  parallel_for(choices.size(), request.threads, [&](std::size_t start) {
    try {
      choices[start] = chosen(request, places, start);
    } catch (const InputError& refusal) {
      refusals[start] = refusal.what();
    }
    const std::lock_guard lock(mutex);
    done += 1.0;
    if (request.choosing) {
      request.choosing(done / static_cast<double>(choices.size()));
    }
  });
  const auto best = std::max_element(choices.begin(), choices.end(),
                                     [](const Choice& a, const Choice& b) { return a.value < b.value; });
  if (best->members.empty()) {
    throw InputError(refusals.front());
  }
  return std::move(*best);
}

// The information that is left for the arm where the bases are unknown, in its own units.
MatrixXd information_of_arm(const Choice& choice, const std::vector<std::size_t>& members) {
  const Index arm = choice.scale.size() - choice.bases;
  const MatrixXd M = information(choice, members);
  const MatrixXd C_b = inverse(M.topLeftCorner(choice.bases, choice.bases));
  const MatrixXd beside = M.bottomLeftCorner(arm, choice.bases);
  const VectorXd unscaled = choice.scale.tail(arm).cwiseInverse();
  return unscaled.asDiagonal() * (M.bottomRightCorner(arm, arm) - beside * C_b * beside.transpose()) *
         unscaled.asDiagonal();
}

// The arm alone, in the base frame.
Experiment experiment_of(const PlanRequest& request, const DeterminedByRows& determined) {
  Experiment experiment{.model = complete_model(request.robot), .targets = request.targets, .noise = request.noise};
  experiment.errors = VectorXd::Zero(static_cast<Index>(experiment.model.parameters.size()));
  experiment.free = Unknowns(experiment.model, experiment.targets, determined.arm_names);
  return experiment;
}

// Station after station, and within each by a short way.
std::vector<Index> in_order(const std::vector<MovingJoint>& joints, VectorXd home, const Measurements& chosen) {
  const std::vector<std::int16_t> stations = stations_of_configurations(chosen);
  std::vector<Index> order;
  for (std::size_t station = 0; station < chosen.stations.size(); ++station) {
    const std::vector<std::size_t> own = indices_at_station(stations, station);  // each has some
    for (const Index stop : short_way(joints, home, chosen.joint_values(Eigen::all, own))) {
      order.push_back(static_cast<Index>(own[static_cast<std::size_t>(stop)]));
    }
    home = chosen.joint_values.col(order.back());
  }
  return order;
}

MeasuringPlan sheet(const Measurements& chosen, const std::vector<Index>& order, const Places& places) {
  const std::vector<std::int16_t> stations = stations_of_configurations(chosen);
  MeasuringPlan result{.joint_values = chosen.joint_values(Eigen::all, order), .targets = chosen.targets};
  if (!places.sockets.empty()) {
    result.notes = {
        "Put the plate near each place of the plan, set the ball into the socket x, y, z of each row, and "
        "replace the joint values by those that the controller shows."};
    result.points.resize(3, std::ssize(order));
  } else {
    result.notes = {places.directions == "xyz" ? "Measure every target in every configuration and fill in x, y and z."
                    : places.directions == "r"
                        ? "Measure every target in every configuration and fill in the distance from the anchor."
                        : "Measure every target in every configuration and fill in " + places.directions +
                              ", and leave the other coordinates empty."};
    result.distances = places.directions == "r";
  }
  for (std::size_t i = 0; i < order.size(); ++i) {
    const auto c = static_cast<std::size_t>(order[i]);
    result.configurations.push_back(std::to_string(i + 1));
    result.stations.push_back(chosen.stations[static_cast<std::size_t>(stations[c])]);
  }
  for (const Observation& o : chosen.observations) {
    if (result.points.cols() > 0) {
      result.points.col(std::find(order.begin(), order.end(), o.configuration) - order.begin()) = o.position();
    }
  }
  return result;
}

// The nominal robot at the places of the choice, and the chosen rows.
PlacedRows chosen_rows(const Choice& choice) {
  std::vector<bool> is_chosen(choice.candidates.size(), false);
  for (const std::size_t member : choice.members) {
    is_chosen[member] = true;
  }
  return {.robot = choice.rows.robot, .measurements = subset(choice.rows.measurements, [&](const Observation& o) {
                                        return is_chosen[static_cast<std::size_t>(o.configuration)];
                                      })};
}

void require_determined(const DeterminedByRows& determined, int count) {
  if (determined.arm.rank == determined.arm.columns) {
    return;
  }
  std::string tied;
  for (const std::vector<std::string>& names : determined.arm.tied) {
    tied += "; not told apart: " + comma_separated(names);
  }
  refuse_input(fmt::format("{} configurations at these places determine {} of {} parameters of the arm{}", count,
                           determined.arm.rank, determined.arm.columns, tied),
               "more configurations, places, sockets or directions");
}

}  // namespace

PlacesPlan plan_at_places(const PlanRequest& request, const Places& places) {
  constexpr int kRandomDesigns = 20;
  require_at_least("starts", request.starts, 1);
  require_at_least("configurations to choose", request.count, places.stations);
  const Choice best = best_choice(request, places);
  PlacesPlan plan{.rows = chosen_rows(best), .determined = {}, .sheet = {}, .planned = {}, .random = {}};
  plan.determined = determined_by(plan.rows);
  require_determined(plan.determined, request.count);

  std::vector<MatrixXd> designs = {information_of_arm(best, best.members)};
  Random random(request.seed, static_cast<std::uint64_t>(request.starts));
  for (int design = 0; design < kRandomDesigns; ++design) {
    designs.push_back(information_of_arm(best, drawn(best, request.count, random)));
  }
  const Candidates drawn = candidates(request.robot, request.targets, request.cell,
                                      {.count = request.workspace, .seed = request.seed, .threads = request.threads});
  plan.narrowed = narrowed_ranges(request.robot, request.targets, request.cell, drawn, request.seed);
  const MatrixXd& tasks = request.tasks.size() > 0 ? request.tasks : drawn.joint_values;
  const std::vector<Prediction> predictions =
      predicted(experiment_of(request, plan.determined), designs, tasks, request.threads);
  plan.planned = predictions.front();
  plan.random = mean_of({predictions.begin() + 1, predictions.end()});

  const VectorXd home =
      request.home.size() > 0 ? request.home : VectorXd::Zero(static_cast<Index>(request.robot.joints.size()));
  plan.sheet = sheet(plan.rows.measurements, in_order(request.robot.joints, home, plan.rows.measurements), places);
  plan.seconds = way_time(request.robot.joints, home, plan.sheet.joint_values);
  return plan;
}

}  // namespace kdl_calibration
