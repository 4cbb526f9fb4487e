#pragma once

// Normal equations of many configurations in which the same points were measured with the same weights. Not installed.
//
// All points k act on the chain through the motion of one frame P, parallel to the flange's, whose origin is the
// weighted mean of the points. With t_k the points in P, w_k their weights, w = sum w_k and S = L L^T the matrix
// sum (w_k / w) (|t_k|^2 I - t_k t_k^T), a body twist (v, a) of P moves them by v + a x t_k, so that
//   sum w_k |v + a x t_k|^2 = w (|v|^2 + |L^T a|^2).
// A configuration thus costs 6 rows of the Jacobian, whatever the number of points, and a column that is a pure
// translation 3. With X_WP = (R, p), residuals e_k = R^T (z_k - p) - t_k and columns (v, a):
//   gram     = sum [v; L^T a] [v; L^T a]^T   (times w: the information of the chain's columns)
//   gradient = sum v . F + a . M,            F = sum w_k e_k,  M = sum w_k t_k x e_k
//   twist    = sum (v, a),                   force_k = sum w_k e_k,  cost = sum w_k |e_k|^2
// where the outer sums are over the configurations. They run over kLanes configurations side by side.

#include <array>
#include <cstddef>
#include <vector>

#include "estimation/lanes.hpp"

namespace kdl_calibration {

/// Rotation row by row, then the position.
using FrameNumbers = std::array<double, 12>;

/// A parameter's twist in joint frame `frame` (0: base, i + 1: joint frame i, joints + 1: flange).
struct ChainColumn {
  int frame = 0;
  bool moves = false;  // has a linear part
  bool turns = false;  // has an angular part; all such columns come first
  std::array<double, 3> linear = {};
  std::array<double, 3> angular = {};
};

struct ChainKernelInput {
  std::vector<FrameNumbers> links;  // as FoldedChain::links, the last one prolonged to P
  std::vector<unsigned char> prismatic;
  FrameNumbers base = {};    // X_WB
  FrameNumbers flange = {};  // X_FP
  std::vector<ChainColumn> columns;
  std::size_t turning = 0;                    // number of columns that turn
  std::vector<std::array<double, 3>> points;  // t_k
  std::vector<double> weights;                // w_k
  std::array<double, 6> root = {};            // L: 00 10 11 20 21 22
  /// Per block of kLanes configurations: joints rows, then x y z of each point.
  const LaneRow* data = nullptr;
  std::size_t configurations = 0;
};

/// Rows of `gram`: for each turning column i the columns j >= i, then for each of the others the same.
struct ChainKernelSums {
  double cost = 0.0;
  std::vector<double> gram;
  std::vector<double> gradient;  // per column
  std::vector<double> twist;     // 6 per column
  std::vector<double> force;     // 3 per point
  // Workspace.
  std::vector<LaneRow> lanes;     // cost, gradient, twist, force, gram: what each lane adds up, one part of the lanes
                                  // (a register of the instruction set) after the other
  std::vector<LaneRow> turns;     // 2 per joint: sine and cosine
  std::vector<LaneRow> poses;     // 15 per frame: rotation, position, and the position in the frame P
  std::vector<LaneRow> jacobian;  // 6 per column, of two blocks
};

/// The sums over all configurations; with `cost_only` nothing but the cost. Angles beyond kLargestAngle lose accuracy.
void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums);

/// The same with a given instruction set; every one gives the same bits.
enum class InstructionSet { baseline, avx2, avx512 };
void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums, InstructionSet set);
/// Those that this machine has, the widest last.
std::vector<InstructionSet> instruction_sets();

constexpr double kLargestAngle = 1e5;

}  // namespace kdl_calibration
