#!/usr/bin/env bash
set -euo pipefail
# shellcheck source-path=SCRIPTDIR source=common.sh
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

tidy=no
others=()
for option in "$@"; do
  case $option in
    --tidy) tidy=yes ;;
    *) others+=("$option") ;;
  esac
done
read_options "Installs what is missing and checks form: clang-format on every source, shellcheck on every script.
  --tidy  clang-tidy on every source as well, with the compile commands of build/release: the better part of an hour" \
  "${others[@]}"
install_missing "${build_packages[@]}" "${test_packages[@]}" clang-format shellcheck

cd "$root"
mapfile -t sources < <(git ls-files '*.cpp' '*.hpp')
mapfile -t scripts < <(git ls-files '*.sh' .ci/run)
clang-format --dry-run -Werror "${sources[@]}"
shellcheck "${scripts[@]}"
echo "${#sources[@]} sources are formatted, ${#scripts[@]} scripts without a finding"
[ "$tidy" = yes ] || exit 0

install_missing clang-tidy
cmake --preset release -D KDL_CALIBRATION_BUILD_TESTS=ON >/dev/null
# Headers are looked at where they are included. What is no part of this build has no compile command.
found=0
git ls-files 'src/*.cpp' 'tests/*.cpp' | grep -vE '^tests/(benchmark/|fuzz/fuzzer\.cpp)' |
  xargs -P "$jobs" -n 1 clang-tidy --quiet -p build/release >build/release/clang-tidy.log 2>/dev/null || found=1
if [ "$found" -ne 0 ]; then
  grep -E '(warning|error):' build/release/clang-tidy.log | sort -u
  echo "clang-tidy: findings, see $root/build/release/clang-tidy.log" >&2
  exit 1
fi
echo "clang-tidy finds nothing"
