#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Installs what is missing, builds the library in build/tsan with the thread sanitizer and asks every const method of the
public headers from two threads." "$@"
install_missing "${build_packages[@]}" "${test_packages[@]}"
cd "$root"
cmake --preset tsan
cmake --build build/tsan -j "$jobs" --target threads_test parallel_test
for suite in threads_test parallel_test; do
  (cd build/tsan/tests && "./$suite" --gtest_brief=1)
done
echo "the thread sanitizer has no finding"
