#pragma once

#include <string>

#include "cli/plan_arguments.hpp"
#include "planning/places_plan.hpp"
#include "planning/planner.hpp"

namespace kdl_calibration::cli {

/// The plan for programs (JSON) and for people.
std::string json_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const Plan& plan);
std::string table_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const Plan& plan);

/// The same of a plan with several stations, single coordinates, distances or touches.
std::string json_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const PlacesPlan& plan);
std::string table_of_plan(const PlanArguments& arguments, const PlanSetting& setting, const PlacesPlan& plan);

}  // namespace kdl_calibration::cli
