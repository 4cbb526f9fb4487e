#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

read_options "Installs what is missing and checks form: clang-format on every source, shellcheck on every script, then
clang-tidy on every source, with the compile commands of build/release. Prints what it finds; none is the aim." "$@"
install_missing "${build_packages[@]}" "${test_packages[@]}" clang-format clang-tidy shellcheck

cd "$root"
mapfile -t sources < <(git ls-files '*.cpp' '*.hpp')
mapfile -t scripts < <(git ls-files '*.sh' .ci/run)
clang-format --dry-run -Werror "${sources[@]}"
shellcheck "${scripts[@]}"
cmake --preset release -D KDL_CALIBRATION_BUILD_TESTS=ON >/dev/null

# Headers are looked at where they are included. What is no part of this build has no compile command.
failed=0
git ls-files 'src/*.cpp' 'tests/*.cpp' | grep -vE '^tests/(benchmark/|fuzz/fuzzer\.cpp)' |
  xargs -P "$jobs" -n 1 clang-tidy --quiet -p build/release >build/release/clang-tidy.log 2>/dev/null || failed=1
if [ "$failed" -ne 0 ]; then
  grep -E '(warning|error):' build/release/clang-tidy.log | sort -u
  echo "clang-tidy: findings, see $root/build/release/clang-tidy.log" >&2
  exit 1
fi
echo "${#sources[@]} sources formatted, ${#scripts[@]} scripts and all sources without a finding"
