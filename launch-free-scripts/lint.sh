#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

tidy=()
others=()
for option in "$@"; do
  case $option in
    --tidy) tidy=('src/*.cpp') ;;
    --tidy-tests) tidy=('src/*.cpp' 'tests/*.cpp') ;;
    *) others+=("$option") ;;
  esac
done
read_options "Installs what is missing and checks form: clang-format on every source, shellcheck on every script.
  --tidy        clang-tidy as well on library and program, with the compile commands of build/release: ten minutes
  --tidy-tests  and on the tests: ten more" \
  "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" clang-format shellcheck

cd "$root"
mapfile -t sources < <(git ls-files '*.cpp' '*.hpp')
mapfile -t scripts < <(git ls-files '*.sh' .ci/run)
clang-format --dry-run -Werror "${sources[@]}"
shellcheck "${scripts[@]}"
echo "${#sources[@]} sources are formatted, ${#scripts[@]} scripts without a finding"
[ "${#tidy[@]}" -gt 0 ] || exit 0

install_missing clang-tidy python3
cmake --preset release -D KDL_CALIBRATION_BUILD_TESTS=ON >/dev/null
# What is no part of this build has no compile command.
mapfile -t sources < <(git ls-files "${tidy[@]}" |
  grep -vE '^tests/(benchmark/|consumer/|fuzz/fuzzer\.cpp|faults\.cpp)')
python3 launch-free-scripts/tidy_units.py build/release "${sources[@]}" >build/release/tidy_units.txt
found=0
xargs -P "$jobs" -n 1 clang-tidy --quiet -p build/release/tidy --checks=-bugprone-suspicious-include \
  --header-filter='/(include/kdl_calibration|src|tests)/.*\.[ch]pp$' \
  <build/release/tidy_units.txt >build/release/clang-tidy.log 2>/dev/null || found=1
if [ "$found" -ne 0 ]; then
  grep -E '(warning|error):' build/release/clang-tidy.log | sort -u
  echo "clang-tidy: findings, see $root/build/release/clang-tidy.log" >&2
  exit 1
fi
echo "clang-tidy finds nothing in ${#sources[@]} sources"
