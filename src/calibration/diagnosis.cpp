#include "calibration/diagnosis.hpp"

#include <fmt/core.h>
#include <algorithm>
#include <iterator>
#include <set>
#include <utility>

#include "base/counted_fits.hpp"
#include "base/text.hpp"
#include "calibration/doubts.hpp"
#include "diagnosis/likely_mistake.hpp"
#include "diagnosis/own_alternatives.hpp"
#include "diagnosis/repeated_configurations.hpp"
#include "estimation/identification.hpp"
#include "measurements/readings.hpp"
#include "measurements/stations.hpp"
#include "measurements/training_rows.hpp"
#include "model/parameters.hpp"

namespace kdl_calibration {
namespace {

ReadingSearch readings(const CalibrationResult& found, const Measurements& measurements, const DiagnosisTask& task) {
  if (!task.options.try_readings) {
    return {};
  }
  if (auto moved = moved_between_repeats(found.model, measurements, found.fit.identification.estimate)) {
    return {.readings = {std::move(*moved)}, .detectable = {}};
  }
  if (!are_points_of_one_station(measurements)) {
    const TrainingRows rows(measurements);
    ReadingSearch search{.readings = readings_of_unit(found.model, *rows), .detectable = {}};
    std::vector<AlternativeReading>& result = search.readings;
    if (result.empty() && has_converged(found.fit.identification)) {
      MistakeSearch likely = likely_mistake({.model = found.model,
                                             .measurements = *rows,
                                             .estimate = found.fit.identification.estimate,
                                             .known = task.parameters.known,
                                             .fix = task.parameters.fix,
                                             .uncertainty = found.uncertainty.predicted.measured.rms,
                                             .stated = found.settings.noise.stated,
                                             .scale_sigma = found.settings.noise.scale_sigma,
                                             .unknowns = found.fit.free.size(),
                                             .alternatives = task.options.alternatives,
                                             .threads = task.threads});
      search.detectable = std::move(likely.detectable);
      if (likely.mistake) {
        result.push_back(std::move(*likely.mistake));
      }
      std::move(likely.own.begin(), likely.own.end(), std::back_inserter(result));
    }
    if (!has_single_coordinates(measurements)) {
      const std::vector<AlternativeReading> repeated = repeated_configurations(measurements);
      std::copy_if(repeated.begin(), repeated.end(), std::back_inserter(result),
                   [](const AlternativeReading& reading) { return reading.cause == Cause::copied_rows; });
    }
    return search;
  }
  return search_readings(found.model, measurements, found.fit.identification.estimate, found.fit.free,
                         {.registration = {.known = task.parameters.known},
                          .used = task.options.convention ? &*task.options.convention : nullptr,
                          .others = task.options.other_conventions,
                          .fix = task.parameters.fix,
                          .uncertainty = found.uncertainty.predicted.measured.rms,
                          .stated = found.settings.noise.stated,
                          .scale_sigma = found.settings.noise.scale_sigma,
                          .alternatives = task.options.alternatives,
                          .threads = task.threads,
                          .progress = task.progress});
}

// The findings that remain valid given other readings of the data. A moved base is not reported as a slipped target,
// and residuals of misread data say nothing about single rows.
std::vector<QualityFinding> remaining_findings(const std::vector<AlternativeReading>& readings,
                                               const Measurements& measurements, std::vector<QualityFinding> findings) {
  const auto any = [&](const auto& matches) {
    return std::any_of(readings.begin(), readings.end(),
                       [&](const AlternativeReading& reading) { return reading.doubt && matches(reading.cause); });
  };
  if (any([](Cause cause) { return cause == Cause::exchanged_targets; })) {
    return {};
  }
  if (any([](Cause cause) {
        return cause == Cause::moved_base || cause == Cause::drift || cause == Cause::moved_target;
      })) {
    std::erase_if(findings, [](const QualityFinding& finding) { return finding.kind == QualityKind::slipped_target; });
    return findings;
  }
  return any([](Cause) { return true; }) ? check_distances(measurements) : findings;
}

// An unknown base, or target, takes up nearly all that its only configuration shows.
std::vector<Remark> lonely_names(const Measurements& measurements, const ParameterOptions& parameters) {
  std::vector<std::set<std::int32_t>> of_station(measurements.stations.size());
  std::vector<std::set<std::int32_t>> of_target(measurements.targets.size());
  for (const Observation& observation : measurements.observations) {
    of_target[static_cast<std::size_t>(observation.target)].insert(observation.configuration);
    if (of_station.size() > 1) {
      of_station[station_of(observation)].insert(observation.configuration);
    }
  }
  std::vector<Remark> result;
  const auto say = [&](SubjectKind kind, const std::string& name, const std::set<std::int32_t>& configurations) {
    if (configurations.size() == 1) {
      const std::string& only = measurements.configurations[static_cast<std::size_t>(*configurations.begin())];
      result.push_back(
          {.cause = Cause::lonely_name,
           .subjects = {{kind, name}, {SubjectKind::configuration, only}},
           .message = fmt::format(
               "{} {} has configuration {} alone, which says hardly anything of the arm: is the name mistyped?",
               to_string(kind), shown(name), only)});
    }
  };
  for (std::size_t station = 0; station < of_station.size(); ++station) {
    if (const std::string& name = measurements.stations[station]; find_base(parameters.known.bases, name) == nullptr) {
      say(SubjectKind::station, name, of_station[station]);
    }
  }
  for (std::size_t target = 0; target < of_target.size(); ++target) {
    const std::string& name = measurements.targets[target];
    if (find_target(parameters.known.targets, name) == nullptr) {
      say(SubjectKind::target, name, of_target[target]);
    }
  }
  return result;
}

// None if all rows are whole points.
std::vector<Remark> said_of_single_coordinates(const Measurements& measurements) {
  const std::size_t rows = rows_of_single_coordinates(measurements);
  if (rows == 0) {
    return {};
  }
  const Observation& row =
      *std::find_if_not(measurements.observations.begin(), measurements.observations.end(), is_whole);
  const std::string& configuration = measurements.configurations[static_cast<std::size_t>(row.configuration)];
  const std::string& target = measurements.targets[static_cast<std::size_t>(row.target)];
  return {{.cause = Cause::single_coordinates,
           .subjects = {{SubjectKind::configuration, configuration}, {SubjectKind::target, target}},
           .figures = {{"count", static_cast<double>(rows)},
                       {"out_of", static_cast<double>(measurements.observations.size())}},
           .message = fmt::format(
               "{} of {} rows are single coordinates or distances, first {}:{}: their errors are lengths along the "
               "measured directions, less than those of whole points, and some checks are not tried",
               rows, measurements.observations.size(), configuration, target)}};
}

// Remarks of the earlier stages.
std::vector<Remark> earlier_remarks(const ModelSelection& selection, const Measurements& measurements,
                                    const DiagnosisTask& task) {
  std::vector<Remark> result = lonely_names(measurements, task.parameters);
  if (const std::size_t points = selection.not_compared; points > 0) {
    result.push_back(
        {.cause = Cause::points_not_compared,
         .figures = {{"count", static_cast<double>(points)}},
         .message = fmt::format("models were compared without {}{} no other fold of the cross-validation has", points,
                                points == 1 ? " point, whose target" : " points, whose targets")});
  }
  result.insert(result.end(), task.remarks.begin(), task.remarks.end());
  const std::vector<Remark> single = said_of_single_coordinates(measurements);
  result.insert(result.end(), single.begin(), single.end());
  if (!measurements.remark.empty()) {
    result.push_back({.cause = Cause::file_interpreted, .message = "measurements: " + measurements.remark});
  }
  return result;
}

}  // namespace

Diagnosis diagnose(const CalibrationResult& found, const Measurements& measurements,
                   std::vector<QualityFinding> findings, GrossRows gross_rows, const DiagnosisTask& task) {
  Diagnosis result;
  result.gross_rows = std::move(gross_rows);
  ReadingSearch search = with_progress(task.progress, "trying other readings of the data",
                                       [&] { return readings(found, measurements, task); });
  result.alternative_readings = std::move(search.readings);
  std::vector<AlternativeReading> left = untried(task.options.alternatives, result.alternative_readings);
  std::move(left.begin(), left.end(), std::back_inserter(result.alternative_readings));
  result.detectable = std::move(search.detectable);
  result.findings = remaining_findings(result.alternative_readings, measurements, std::move(findings));
  result.doubts = doubts(found, result, measurements, task.parameters.model);
  if (holds_where_measured(found, result.doubts, task.ambiguity)) {
    result.reservation = std::move(result.doubts.front());
    result.doubts.clear();
  }
  result.remarks = earlier_remarks(found.selection, measurements, task);
  const std::vector<Remark> more = remarks(found, result, measurements, task.ambiguity);
  result.remarks.insert(result.remarks.end(), more.begin(), more.end());
  return result;
}

}  // namespace kdl_calibration
