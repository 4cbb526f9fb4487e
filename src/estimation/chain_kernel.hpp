#pragma once

// Normal equations of many configurations in which the same points were measured with the same weights.
//
// Positions depend on the chain only through a frame P. It is parallel to the flange frame, with its origin at the
// weighted mean of the points. With t_k the points in P, w_k their weights, w = sum w_k and S = L L^T the matrix sum
// (w_k / w) (|t_k|^2 I - t_k t_k^T), a body twist (v, a) of P moves them by v + a x t_k, so that
//   sum w_k |v + a x t_k|^2 = w (|v|^2 + |L^T a|^2).
// A configuration thus needs 6 rows of the Jacobian for any number of points, 3 for a column of pure translation. With
// X_WP = (R, p), residuals e_k = R^T (z_k - p) - t_k and columns (v, a):
//   gram     = sum [v; L^T a] [v; L^T a]^T   (times w: the information of the chain's columns)
//   gradient = sum v . F + a . M,            F = sum w_k e_k,  M = sum w_k t_k x e_k
//   coupling = sum (v, a),                   force_k = sum w_k e_k,  cost = sum w_k |e_k|^2
// where the outer sums are over the configurations, kLanes of them in parallel.
//
// Noise that differs along the axes x of W: a configuration is stored as rows j of m_jx = sum_l U_jl,x z_l,x with
// independent errors of variance 1, where U_x^T U_x is the information of the coordinates x. With r_x row x of R, u_jx
// = sum_l U_jl,x and s_jx = sum_l U_jl,x t_l
//   e_jx = m_jx - u_jx p_x - r_x . s_jx,   its derivative (u_jx r_x) . v + (s_jx x r_x) . a,   U_jl,x r_x . dt_l,
// whose squares are the information G(q) of the twist (v, a); M with G = M^T M takes the place of [v; L^T a] (w is 1):
//   coupling = sum (v, a) . K_lc,  K_lc = sum_jx U_jl,x r_xc (u_jx r_x, s_jx x r_x),  turned_x = sum r_x r_x^T
//
// If every configuration has its own information, e.g. along a line of sight, it stores the upper triangular root U,
// with a row j of 1 x 3 blocks U_jl for each coordinate. With g_jl = R^T U_jl^T
//   e_j = sum_l g_jl . e_l,  its derivative (sum_l g_jl) . v + (sum_l t_l x g_jl) . a,  g_jl . dt_l,
// from which G(q), K_lc and the sums `turned` of g_jl,c g_jm,d follow likewise.
//
// A measured orientation Z of the target frame T, of weight o and with the error e = log(R_PT^T R^T Z), depends on a
// only. It adds (o / w) I to S or o I to G's block of a, R_PT o e to M, o |e|^2 to the cost and o e, in T, to the
// force.
//
// Effect terms add to a joint's value: motion m is sum_k value_k phi_k with one number phi_k per configuration. A
// term's column is phi_k times its motion's, so products are formed once per pair of motions and spread:
//   spread   = sum phi_k [v; L^T a]_m [v; L^T a]_i^T and sum phi_k phi_l [v; L^T a]_m [v; L^T a]_n^T

#include <array>
#include <cstddef>
#include <vector>

#include "estimation/lanes.hpp"

namespace kdl_calibration {

/// A pose: rotation row by row, then position.
using FrameNumbers = std::array<double, 12>;

/// A parameter's twist in joint frame `frame` (0: base, i + 1: joint frame i, joints + 1: flange, joints + 2 + i: joint
/// frame i after its tilts).
struct ChainColumn {
  int frame = 0;
  bool moves = false;  // has a linear part
  bool turns = false;  // has an angular part; all such columns come first
  std::array<double, 3> linear = {};
  std::array<double, 3> angular = {};
};

/// A motion by the terms first … last - 1, of which the first `free` have columns.
struct ChainMotion {
  std::size_t entry = 0;  // index into joint values, tilts and stretches, see FoldedChain
  ChainColumn column;
  std::size_t first = 0;
  std::size_t free = 0;
  std::size_t last = 0;
};

/// R_PT of a target with measured orientation, row by row.
using OrientationNumbers = std::array<double, 9>;

/// u and s of a row.
struct AxisRow {
  double sum = 0.0;
  std::array<double, 3> target = {};
};

/// Rows of data per orientation.
constexpr std::size_t kOrientationRows = 10;
/// Rows of data of the root of the information of that many points.
constexpr std::size_t root_rows(std::size_t points, bool coupled) {
  return coupled ? 3 * points * (3 * points + 1) / 2 : 6 * points;
}

struct ChainKernelInput {
  std::vector<FrameNumbers> links;  // as FoldedChain::links, the last one extended to P
  std::vector<unsigned char> prismatic;
  FrameNumbers base = {};    // X_WB
  FrameNumbers flange = {};  // X_FP
  std::vector<ChainColumn> columns;
  std::size_t turning = 0;                    // number of columns that turn
  std::vector<std::array<double, 3>> points;  // t_k
  std::vector<double> weights;                // w_k
  std::array<double, 6> root = {};            // L: 00 10 11 20 21 22
  // Instead of points, weights and root:
  std::vector<AxisRow> kept;   // of row j and axis x: 3 j + x
  std::vector<AxisRow> pulls;  // of target l and axis x (3 l + x): sum_j U_jl,x (u_jx, s_jx)
  std::vector<double> shares;  // U_jl,x at (3 j + x) targets + l
  // Instead of weights and root:
  bool own_roots = false;  // U is stored in the data,
  bool coupled = false;    // completely, else only the blocks U_jl of a point's own rows j
  std::vector<OrientationNumbers> oriented;
  std::vector<ChainMotion> motions;              // with consecutive ranges of terms
  std::vector<double> values;                    // of the terms
  bool tilts = false;                            // whether motions tilt joints
  std::vector<std::array<double, 3>> stretches;  // as FoldedChain::stretches if motions expand links, with `tilts`
  /// Per block of kLanes configurations: joints rows, then x y z of each point or row j, then U row by row from the
  /// diagonal on, then of each orientation Z row by row and o, then phi of each term.
  const LaneRow* data = nullptr;
  std::size_t configurations = 0;

  bool by_axis() const { return !kept.empty(); }
  bool in_rows() const { return by_axis() || own_roots; }
  /// Number of targets with coordinates in the kernel.
  std::size_t targets() const { return by_axis() ? pulls.size() / 3 : points.size(); }
  /// Numbers in `coupling` per column: those for positions, then three for each orientation, sum o a.
  std::size_t width_of_positions() const { return in_rows() ? 3 * targets() : 6; }
  std::size_t width() const { return width_of_positions() + 3 * oriented.size(); }
  std::size_t first_orientation() const {
    return prismatic.size() + (by_axis() ? kept.size() : 3 * points.size()) +
           (own_roots ? root_rows(points.size(), coupled) : 0);
  }
  std::size_t rows() const { return first_orientation() + kOrientationRows * oriented.size() + values.size(); }
  std::size_t entries() const { return (!stretches.empty() ? 4 : tilts ? 3 : 1) * prismatic.size(); }
};

/// Rows of `gram`: for each turning column i the columns j >= i, then for each of the others the same. Rows of
/// `spread`: for each motion, its terms by column; then for each motion from this one on, for each own term, the
/// other's terms (for the same motion from the own term on).
struct ChainKernelSums {
  double cost = 0.0;
  std::vector<double> gram;
  std::vector<double> spread;
  std::vector<double> gradient;  // per column, then per term
  std::vector<double> coupling;  // per column, then per term: 6, its twist, or in rows 3 per target; 3 per orientation
  std::vector<double> force;     // 3 per point, or in rows 3 per target, then 3 per orientation
  std::vector<double> turned;    // by axis: 00 01 02 11 12 22 each; own roots: that triangle for all coordinates
  std::vector<double> weights;   // per orientation: sum o
  // Workspace.
  std::vector<LaneRow> lanes;     // sums per lane of cost, gradient, coupling, force, turned, weights, gram and spread;
                                  // one register's part of the lanes after the other
  std::vector<LaneRow> joints;    // values and tilts
  std::vector<LaneRow> turns;     // 2 of each: sine and cosine
  std::vector<LaneRow> poses;     // 15 per frame: rotation, position, and the position in the frame P
  std::vector<LaneRow> jacobian;  // 6 per column and motion, for several blocks
  std::vector<LaneRow> forces;    // additions to gradient and coupling, per motion of these blocks
  std::vector<LaneRow> pulls;     // 18 per target: K, and with roots of their own 6 more: e_l, then g_jl
  std::vector<LaneRow> turning;   // o of each orientation
};

/// The sums over all configurations; only the cost if `cost_only`. Angles beyond kLargestAngle lose accuracy.
void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums);

/// Adds the sums over other configurations, without the workspace.
void add(const ChainKernelSums& others, ChainKernelSums& sums);

/// The same with a given instruction set; the results are bitwise equal.
enum class InstructionSet { baseline, avx2, avx512 };
void sum_chain(const ChainKernelInput& input, bool cost_only, ChainKernelSums& sums, InstructionSet set);
/// Instruction sets of this machine, the widest last.
std::vector<InstructionSet> instruction_sets();

constexpr double kLargestAngle = 1e5;

}  // namespace kdl_calibration
