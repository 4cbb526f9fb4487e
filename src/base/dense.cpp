#include "base/dense.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

#include "base/preconditions.hpp"

namespace kdl_calibration {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Ref;

namespace {

constexpr Index kDepth = 256;                 // columns of the factors that are multiplied at a time
constexpr Index kRowsAtOnce = 8 * kTileRows;  // of A in cache
constexpr Index kSmall = 48;                  // size up to which triangles are not divided further

using Two = double __attribute__((vector_size(16), aligned(8), may_alias));
using Four = double __attribute__((vector_size(32), aligned(8), may_alias));
using Eight = double __attribute__((vector_size(64), aligned(8), may_alias));

// tile (column by column) = product of a panel of kTileRows and one of kTileColumns rows, both stored column by column.
template <class Vector>
inline __attribute__((always_inline)) void multiply(const double* a, const double* b, Index depth, double* tile) {
  constexpr Index kWidth = sizeof(Vector) / sizeof(double);
  for (Index first = 0; first < kTileRows; first += 3 * kWidth) {
    Vector sums[kTileColumns][3] = {};
    for (Index k = 0; k < depth; ++k) {
      const double* const column = a + k * kTileRows + first;
      const Vector a0 = *reinterpret_cast<const Vector*>(column);
      const Vector a1 = *reinterpret_cast<const Vector*>(column + kWidth);
      const Vector a2 = *reinterpret_cast<const Vector*>(column + 2 * kWidth);
#pragma GCC unroll 4
      for (Index j = 0; j < kTileColumns; ++j) {
        const double value = b[k * kTileColumns + j];
        sums[j][0] += a0 * value;
        sums[j][1] += a1 * value;
        sums[j][2] += a2 * value;
      }
    }
    for (Index j = 0; j < kTileColumns; ++j) {
      for (Index i = 0; i < 3; ++i) {
        *reinterpret_cast<Vector*>(tile + j * kTileRows + first + i * kWidth) = sums[j][i];
      }
    }
  }
}

// y -= factors[0] x_0, or of four columns x_k = x + k rows, in the rows from the register that holds row `first` on.
template <class Vector, Index kColumns>
inline __attribute__((always_inline)) void subtract(const double (&factors)[kColumns], const double* x, Index first,
                                                    Index rows, double* y) {
  constexpr Index kWidth = sizeof(Vector) / sizeof(double);
  for (Index row = first / kWidth * kWidth; row < rows; row += kWidth) {
    Vector parts[kColumns];
    for (Index k = 0; k < kColumns; ++k) {
      std::memcpy(&parts[k], x + k * rows + row, sizeof(Vector));  // need not lie at multiples of a register
      parts[k] *= factors[k];
    }
    Vector left;
    std::memcpy(&left, y + row, sizeof(Vector));
    if constexpr (kColumns == 4) {
      left -= (parts[0] + parts[1]) + (parts[2] + parts[3]);
    } else {
      left -= parts[0];
    }
    std::memcpy(y + row, &left, sizeof(Vector));
  }
}

// See SmallFactor. Four columns at a time.
template <class Vector>
inline __attribute__((always_inline)) double factorise_columns(double least, Index n, Index rows, double* A) {
  constexpr Index kWidth = sizeof(Vector) / sizeof(double);
  double smallest = 1.0;
  for (Index first = 0; first < n; first += 4) {
    const Index end = std::min(first + 4, n);
    for (Index j = first; j < end; ++j) {
      double* const column = A + j * rows;
      for (Index k = first; k < j; ++k) {
        subtract<Vector, 1>({A[k * rows + j]}, A + k * rows, j, rows, column);
      }
      smallest = std::min(smallest, column[j]);
      if (!(smallest > least)) {
        return 0.0;
      }
      const double root = std::sqrt(column[j]);
      for (Index row = j / kWidth * kWidth; row < rows; row += kWidth) {
        Vector part;
        std::memcpy(&part, column + row, sizeof(Vector));
        part /= root;
        std::memcpy(column + row, &part, sizeof(Vector));
      }
    }
    const double* const four = A + first * rows;
    for (Index c = end; c < n; ++c) {  // only reached after four full columns
      subtract<Vector, 4>({four[c], four[rows + c], four[2 * rows + c], four[3 * rows + c]}, four, c, rows,
                          A + c * rows);
    }
  }
  return smallest;
}

double factorise_two(double least, Index n, Index rows, double* A) { return factorise_columns<Two>(least, n, rows, A); }
void multiply_two(const double* a, const double* b, Index depth, double* tile) { multiply<Two>(a, b, depth, tile); }
#ifdef __x86_64__
__attribute__((target("avx2"))) void multiply_four(const double* a, const double* b, Index depth, double* tile) {
  multiply<Four>(a, b, depth, tile);
}
__attribute__((target("avx512f"))) void multiply_eight(const double* a, const double* b, Index depth, double* tile) {
  multiply<Eight>(a, b, depth, tile);
}
__attribute__((target("avx2"))) double factorise_four(double least, Index n, Index rows, double* A) {
  return factorise_columns<Four>(least, n, rows, A);
}
__attribute__((target("avx512f"))) double factorise_eight(double least, Index n, Index rows, double* A) {
  return factorise_columns<Eight>(least, n, rows, A);
}
#endif

// Part of a factor.
struct PackedPart {
  Index first_row;
  Index rows;
  Index first_column;
  Index columns;
};

// A part in panels of kHeight rows, each stored column by column; missing rows are zero.
template <Index kHeight>
void pack(const Factor& factor, const PackedPart& part, std::vector<double>& panels) {
  panels.resize(static_cast<std::size_t>((part.rows + kHeight - 1) / kHeight * kHeight * part.columns));
  double* next = panels.data();
  for (Index row = part.first_row; row < part.first_row + part.rows; row += kHeight) {
    const Index here = std::min(kHeight, part.first_row + part.rows - row);
    for (Index k = part.first_column; k < part.first_column + part.columns; ++k, next += kHeight) {
      const double* const from = factor.data + row * factor.row_step + k * factor.column_step;
      const bool stored =
          factor.shape == Shape::full || (factor.shape == Shape::lower ? k <= row : k >= row + here - 1);
      if (stored && here == kHeight && factor.row_step == 1) {
        std::copy_n(from, kHeight, next);
        continue;
      }
      for (Index i = 0; i < here; ++i) {
        const bool zero = !stored && (factor.shape == Shape::lower ? k > row + i : k < row + i);
        next[i] = zero ? 0.0 : from[i * factor.row_step];
      }
      std::fill(next + here, next + kHeight, 0.0);
    }
  }
}

struct Depths {
  Index first;
  Index end;
};

// Columns of the factor that are not zero in these rows.
Depths narrowed(Depths depths, const Factor& factor, Index row, Index rows) {
  if (factor.shape == Shape::upper) {
    depths.first = std::max(depths.first, row);
  } else if (factor.shape == Shape::lower) {
    depths.end = std::min(depths.end, row + rows);
  }
  return depths;
}

void add_tile(double scale, const double* tile, Ref<MatrixXd> sum) {
  for (Index c = 0; c < sum.cols(); ++c) {
    double* const to = &sum(0, c);
    for (Index r = 0; r < sum.rows(); ++r) {
      to[r] += scale * tile[c * kTileRows + r];
    }
  }
}

void add(double scale, const Factor& A, const Factor& B, bool symmetric, Ref<MatrixXd>& sum) {
  require_count("columns of a factor", B.columns, A.columns);
  require_count("rows of a product", sum.rows(), A.rows);
  require_count("columns of a product", sum.cols(), B.rows);
  static const TileProduct multiply_tile = tile_products().back();
  thread_local std::vector<double> a;
  thread_local std::vector<double> b;
  alignas(64) double tile[kTileRows * kTileColumns];
  for (Index first = 0; first < A.columns; first += kDepth) {
    const Index depth = std::min(kDepth, A.columns - first);
    pack<kTileColumns>(B, {0, B.rows, first, depth}, b);
    for (Index top = 0; top < A.rows; top += kRowsAtOnce) {
      const Index rows = std::min(kRowsAtOnce, A.rows - top);
      pack<kTileRows>(A, {top, rows, first, depth}, a);
      for (Index j = 0; j < B.rows; j += kTileColumns) {
        const Index columns = std::min(kTileColumns, B.rows - j);
        const Depths of_b = narrowed({first, first + depth}, B, j, kTileColumns);
        for (Index i = symmetric ? std::max(top, (j - top) / kTileRows * kTileRows + top) : top; i < top + rows;
             i += kTileRows) {
          const auto [begin, end] = narrowed(of_b, A, i, kTileRows);
          if (begin >= end) {
            continue;
          }
          multiply_tile(a.data() + (i - top) * depth + (begin - first) * kTileRows,
                        b.data() + j * depth + (begin - first) * kTileColumns, end - begin, tile);
          add_tile(scale, tile, sum.block(i, j, std::min(kTileRows, A.rows - i), columns));
        }
      }
    }
  }
}

}  // namespace

std::vector<TileProduct> tile_products() {
  std::vector<TileProduct> result = {multiply_two};
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2")) {
    result.push_back(multiply_four);
  }
  if (__builtin_cpu_supports("avx512f")) {
    result.push_back(multiply_eight);
  }
#endif
  return result;
}

std::vector<SmallFactor> small_factors() {
  std::vector<SmallFactor> result = {factorise_two};
#ifdef __x86_64__
  if (__builtin_cpu_supports("avx2")) {
    result.push_back(factorise_four);
  }
  if (__builtin_cpu_supports("avx512f")) {
    result.push_back(factorise_eight);
  }
#endif
  return result;
}

double factorise_small(double least, Ref<MatrixXd> A) {
  static const SmallFactor widest = small_factors().back();
  require_count("rows of a padded matrix", A.rows(), (A.cols() + kPaddedRows - 1) / kPaddedRows * kPaddedRows);
  require_count("distance of its columns", A.outerStride(), A.rows());
  return widest(least, A.cols(), A.rows(), A.data());
}

Factor Factor::transposed() const {
  const Shape turned = shape == Shape::lower ? Shape::upper : shape == Shape::upper ? Shape::lower : Shape::full;
  return {data, columns, rows, column_step, row_step, turned};
}

Factor factor(const Ref<const MatrixXd>& matrix, Shape shape) {
  return {matrix.data(), matrix.rows(), matrix.cols(), 1, matrix.outerStride(), shape};
}

void add_product(double scale, const Factor& A, const Factor& B, Ref<MatrixXd> sum) { add(scale, A, B, false, sum); }

void add_symmetric_product(double scale, const Factor& A, const Factor& B, Ref<MatrixXd> sum) {
  add(scale, A, B, true, sum);
}

MatrixXd product(const Factor& A, const Factor& B) {
  MatrixXd result = MatrixXd::Zero(A.rows, B.rows);
  add_product(1.0, A, B, result);
  return result;
}

MatrixXd symmetric_product(const Factor& A, const Factor& B) {
  MatrixXd result = MatrixXd::Zero(A.rows, B.rows);
  add_symmetric_product(1.0, A, B, result);
  result.triangularView<Eigen::StrictlyUpper>() = result.transpose();
  return result;
}

bool factorise(Ref<MatrixXd> A) {
  const Index n = A.rows();
  if (n == 0) {
    return true;
  }
  if (n <= kSmall) {
    return Eigen::LLT<Ref<MatrixXd>>(A).info() == Eigen::Success;
  }
  const Index half = n / 2;
  auto top = A.topLeftCorner(half, half);
  auto below = A.bottomLeftCorner(n - half, half);
  if (!factorise(top)) {
    return false;
  }
  MatrixXd turned = below.transpose();
  solve_lower(top, turned);
  below = turned.transpose();
  add_symmetric_product(-1.0, factor(below), factor(below), A.bottomRightCorner(n - half, n - half));
  return factorise(A.bottomRightCorner(n - half, n - half));
}

void invert_lower(Ref<MatrixXd> L) {
  const Index n = L.rows();
  if (n <= kSmall) {
    L.triangularView<Eigen::Lower>() = MatrixXd(L.triangularView<Eigen::Lower>().solve(MatrixXd::Identity(n, n)));
    return;
  }
  const Index half = n / 2;
  auto top = L.topLeftCorner(half, half);
  auto bottom = L.bottomRightCorner(n - half, n - half);
  auto below = L.bottomLeftCorner(n - half, half);
  invert_lower(top);
  invert_lower(bottom);
  MatrixXd product = MatrixXd::Zero(n - half, half);
  add_product(-1.0, factor(bottom, Shape::lower), factor(below).transposed(), product);
  below.setZero();
  add_product(1.0, factor(product), factor(top, Shape::lower).transposed(), below);
}

void solve_lower(const Ref<const MatrixXd>& L, Ref<MatrixXd> X) {
  const Index n = L.rows();
  if (n <= kSmall) {
    L.triangularView<Eigen::Lower>().solveInPlace(X);
    return;
  }
  const Index half = n / 2;
  solve_lower(L.topLeftCorner(half, half), X.topRows(half));
  add_product(-1.0, factor(L.bottomLeftCorner(n - half, half)), factor(X.topRows(half)).transposed(),
              X.bottomRows(n - half));
  solve_lower(L.bottomRightCorner(n - half, n - half), X.bottomRows(n - half));
}

}  // namespace kdl_calibration
