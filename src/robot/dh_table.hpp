#pragma once

// Tables of Denavit-Hartenberg parameters, in and out.

#include <kdl/frames.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "kdl_calibration/robot.hpp"

namespace kdl_calibration {

/// With q the joint value, added to theta (revolute) or d (prismatic), and beta as Hayati (1983) for axes that are
/// nearly parallel, else zero:
/// standard (Denavit, Hartenberg 1955): Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta),
/// modified (Craig 1986): Tx(a) Rx(alpha) Ry(beta) Rz(theta) Tz(d).
enum class DhConvention { standard, modified };

struct DhRow {
  std::string joint;
  JointType type = JointType::revolute;  ///< or prismatic
  double a = 0.0;                        ///< [m]
  double alpha = 0.0;                    ///< [rad]
  double beta = 0.0;                     ///< [rad]
  double d = 0.0;                        ///< [m]
  double theta = 0.0;                    ///< [rad]
  std::optional<double> lower = {};      ///< [rad] or [m]; with upper or not at all
  std::optional<double> upper = {};
};

/// The tip in the base is base · row 1 · … · row n · tip.
struct DhTable {
  DhConvention convention = DhConvention::standard;
  KDL::Frame base;
  std::vector<DhRow> rows;
  KDL::Frame tip;
};

/// Tx(a) Rx(alpha) Ry(beta), and Rz(theta) Tz(d) at a joint value of zero.
KDL::Frame dh_across(const DhRow& row);
KDL::Frame dh_along(const DhRow& row);

/// Reads a table. Its first character tells CSV from JSON ({). Throws InputError: no convention, an unknown or missing
/// column, a quantity without unit or with one of another kind, an empty cell, two joints of one name, one limit alone.
DhTable parse_dh_table(std::string_view text, const std::string& source = "DH table");

/// Largest differences of the tips of two chains.
struct PoseDifference {
  double position = 0.0;  ///< [m]
  double rotation = 0.0;  ///< [rad]
};

/// The table as JSON that parse_dh_table reads, in metres and radians. An empty note and no difference are left out.
std::string dh_json(const DhTable& table, const std::string& note = {},
                    const std::optional<PoseDifference>& difference = {});

/// The table as URDF: links base, link_1 ..., tool0. In a modified table link i has the frame of row i; in a standard
/// one the frame of its joint, turned by theta and moved by d. Results hold a hash of this text: do not change it.
std::string dh_urdf(const DhTable& table);

}  // namespace kdl_calibration
