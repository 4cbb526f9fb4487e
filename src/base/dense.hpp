#pragma once

// Products, factors and inverses of large matrices in the widest registers of the machine. Each entry is summed in the
// same order in all registers, without fused multiply-add, so that results are the same bits.

#include <Eigen/Core>
#include <vector>

namespace kdl_calibration {

/// Entries of a factor that are zero and need not be stored: above the diagonal, below it, or none.
enum class Shape { full, lower, upper };

/// A matrix in any order of storage.
struct Factor {
  const double* data = nullptr;
  Eigen::Index rows = 0;
  Eigen::Index columns = 0;
  Eigen::Index row_step = 1;
  Eigen::Index column_step = 0;
  Shape shape = Shape::full;

  Factor transposed() const;
};
Factor factor(const Eigen::Ref<const Eigen::MatrixXd>& matrix, Shape shape = Shape::full);

/// sum += scale A B^T.
void add_product(double scale, const Factor& A, const Factor& B, Eigen::Ref<Eigen::MatrixXd> sum);
/// The same for the lower triangle of a symmetric sum. Entries above it may be changed.
void add_symmetric_product(double scale, const Factor& A, const Factor& B, Eigen::Ref<Eigen::MatrixXd> sum);
/// A B^T.
Eigen::MatrixXd product(const Factor& A, const Factor& B);
/// The same if it is symmetric, at half the cost.
Eigen::MatrixXd symmetric_product(const Factor& A, const Factor& B);

/// Replaces the lower triangle of A = L L^T by L. False if A is not positive definite. Only the lower triangle is used.
bool factorise(Eigen::Ref<Eigen::MatrixXd> A);
/// The same by a faster loop for up to a hundred columns. A has n columns and as many rows as the next multiple of
/// kPaddedRows, zero from row n on; entries above the diagonal are changed. Returns the smallest pivot, at most 1, or
/// zero as soon as one is not above `least`.
double factorise_small(double least, Eigen::Ref<Eigen::MatrixXd> A);
constexpr Eigen::Index kPaddedRows = 8;

/// Replaces the lower triangle L by its inverse.
void invert_lower(Eigen::Ref<Eigen::MatrixXd> L);
/// X <- L^-1 X.
void solve_lower(const Eigen::Ref<const Eigen::MatrixXd>& L, Eigen::Ref<Eigen::MatrixXd> X);

/// A tile of a product: kTileRows x kTileColumns, column by column. The inner loop sums it over `depth` columns of a
/// and b, which hold kTileRows and kTileColumns entries each.
constexpr Eigen::Index kTileRows = 24;  // three of the widest registers
constexpr Eigen::Index kTileColumns = 4;
using TileProduct = void (*)(const double* a, const double* b, Eigen::Index depth, double* tile);
/// The inner loops for the registers of this machine, the narrowest first.
std::vector<TileProduct> tile_products();
/// The same for factorise_small(), of n columns with `rows` rows each.
using SmallFactor = double (*)(double least, Eigen::Index n, Eigen::Index rows, double* A);
std::vector<SmallFactor> small_factors();

}  // namespace kdl_calibration
