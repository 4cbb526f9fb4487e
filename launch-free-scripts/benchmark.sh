#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Installs what is missing, builds the benchmarks in build/release, runs them and prints a table of ratios." "$@"
install_missing "${build_packages[@]}" "${test_packages[@]}" libbenchmark-dev libceres-dev
(cd "$root" && cmake --preset release -D KDL_CALIBRATION_BUILD_BENCHMARKS=ON -D KDL_CALIBRATION_PYTHON=ON &&
  cmake --build build/release -j "$jobs" --target kdl_calibration_benchmark kdl_calibration_python)

results=$(mktemp)
trap 'rm -f "$results"' EXIT
program=$root/build/release/tests/benchmark/kdl_calibration_benchmark
measure() { "$program" --benchmark_color=false "$@" 2>/dev/null >>"$results"; }
# The best of several runs: other work on the machine only ever adds time. What takes minutes runs once, and the memory
# has a process of its own.
measure --benchmark_repetitions=5 --benchmark_filter='-memory|iteration_ceres_qr/300000'
measure --benchmark_filter=iteration_ceres_qr/300000
measure --benchmark_filter=memory
python=$(sed -n 's/^_*Python3_EXECUTABLE:[A-Z]*=//p' "$root/build/release/CMakeCache.txt" | head -n 1)
PYTHONPATH=$root/build/release/src/python "$python" "$root/tests/benchmark/prediction.py" \
  "$root/urdf/fanuc_r2000ic_165f.urdf" >>"$results"

awk '
  $3 ~ /^(ns|us|ms|s)$/ && $1 !~ /_(mean|median|stddev|cv)$/ {
    name = $1
    sub(/\/(iterations:[0-9]+|manual_time|real_time).*/, "", name)
    time = $2 * ($3 == "ns" ? 1e-9 : $3 == "us" ? 1e-6 : $3 == "ms" ? 1e-3 : 1)
    if (!(name in best) || time < best[name]) best[name] = time
    for (i = 7; i <= NF; ++i) {
      split($i, counter, "=")
      value = counter[2] * (counter[2] ~ /Gi?\/s$/ ? 2^30 : counter[2] ~ /Mi?\/s$/ ? 2^20 : 1)  # bytes in binary units
      if (counter[1] == "bytes_per_second" && value > speed[name]) speed[name] = value
      if (counter[1] == "peak_MB") memory = value
      if (name == "compensation_point") compensation[counter[1]] = value
    }
  }
  function row(text, name) {
    if (name in best) printf "%-58s %12.3f ms\n", text, best[name] * 1e3
  }
  function ratio(text, name, other) {
    if (name in best && other in best) printf "%-58s %12.1f x\n", text, best[other] / best[name]
  }
  END {
    print "Published experiment, 30 configurations x 3 points"
    row("  library", "published_library")
    row("  plain Eigen, stacked analytic Jacobian", "published_plain_eigen")
    row("  KDL Jacobian solver", "published_kdl")
    row("  Ceres, dense normal Cholesky", "published_ceres/normal_cholesky")
    row("  Ceres, dense QR", "published_ceres/qr")
    row("  registration without a start", "registration")
    ratio("  library over plain Eigen", "published_library", "published_plain_eigen")
    ratio("  library over KDL", "published_library", "published_kdl")
    ratio("  library over Ceres, dense normal Cholesky", "published_library", "published_ceres/normal_cholesky")
    ratio("  library over Ceres, dense QR", "published_library", "published_ceres/qr")
    print "One iteration per configuration"
    for (n = 30; n <= 300000; n *= 10)
      if (("iteration_library/" n) in best)
        printf "%-58s %12.0f ns\n", "  N = " n, best["iteration_library/" n] / n * 1e9
    for (n = 3000; n <= 300000; n *= 10)
      ratio("  library over Ceres, dense QR, N = " n, "iteration_library/" n, "iteration_ceres_qr/" n)
    ratio("  with 60 effects, N = 30000", "iteration_library/30000", "iteration_effects/30000")
    ratio("  with noise of its own along each axis, N = 30000", "iteration_library/30000", "iteration_by_axis/30000")
    ratio("  with noise in common, N = 30000", "iteration_library/30000", "iteration_correlated/30000")
    ratio("  with noise along a line of sight, N = 30000", "iteration_library/30000", "iteration_tracker/30000")
    ratio("  with measured orientations, N = 30000", "iteration_library/30000", "iteration_poses/30000")
    print "Long measurements, 900,000 points"
    row("  reading the CSV", "read_csv/300000")
    printf "%-58s %12.0f MB/s\n", "  reading the CSV", speed["read_csv/300000"] / 1e6
    row("  fit", "whole_fit_library/300000")
    row("  calibrate, all figures", "calibrate_library/300000")
    if (memory) printf "%-58s %12.0f MB\n", "  peak memory of the fit, data included", memory
    print "1,000 configurations x 3 points, all threads"
    row("  calibrate with one model, all figures", "one_model_library/1000")
    row("  other readings of the data", "hypotheses_library/1000")
    ratio("  calibrate over other readings", "hypotheses_library/1000", "one_model_library/1000")
    print "10,000 Monte Carlo calibrations"
    row("  one thread", "monte_carlo/1")
    row("  two threads", "monte_carlo/2")
    ratio("  two threads over one", "monte_carlo/2", "monte_carlo/1")
    print "40,000 predictions, one thread"
    row("  library", "prediction_library")
    row("  Python package", "prediction_python")
    ratio("  library over Python package", "prediction_library", "prediction_python")
    print "Compensation of a point to 1e-10, one thread, median"
    printf "%-58s %12.1f us\n", "  library", compensation["median_us"]
    printf "%-58s %12.1f us\n", "  KDL, Levenberg-Marquardt", compensation["kdl_median_us"]
    printf "%-58s %12.1f x\n", "  library over KDL", compensation["times_faster"]
  }' "$results"
