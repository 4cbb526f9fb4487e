# Sourced by the scripts beside it: packages, configure, build.
# shellcheck shell=bash disable=SC2034

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
jobs=$(nproc)
assume_yes=no

build_packages=(build-essential cmake libboost-dev libcli11-dev libconsole-bridge-dev libeigen3-dev libfmt-dev
  liborocos-kdl-dev libtinyxml2-dev liburdfdom-dev liburdfdom-headers-dev nettle-dev nlohmann-json3-dev)
test_packages=(libgmock-dev libgtest-dev locales pybind11-dev python3-dev python3-numpy python3-pytest)
clang_packages=(clang libclang-rt-14-dev)
browser_packages=(chromium chromium-driver python3-selenium)  # for the test of the pages, which is skipped without

# Compiles through ccache where there is one.
if command -v ccache >/dev/null; then
  export CMAKE_CXX_COMPILER_LAUNCHER=${CMAKE_CXX_COMPILER_LAUNCHER-ccache}
  export CCACHE_BASEDIR=${CCACHE_BASEDIR-$root} CCACHE_NOHASHDIR=${CCACHE_NOHASHDIR-1}  # clones share what they compile
fi

# read_options "what the script does" "$@"
read_options() {
  local purpose=$1 option
  shift
  for option in "$@"; do
    case $option in
      --yes) assume_yes=yes ;;
      -h | --help)
        echo "usage: $(basename "$0") [--yes]"
        echo "$purpose"
        echo "  --yes  install missing packages through sudo without asking"
        exit 0
        ;;
      *)
        echo "$(basename "$0"): unknown option '$option', expected --yes or --help" >&2
        exit 2
        ;;
    esac
  done
}

# read_data_option "$@": takes `--data DIR` out of the arguments, into `data` (absolute, empty without) and `others`.
read_data_option() {
  data=
  others=()
  while [ $# -gt 0 ]; do
    if [ "$1" = --data ]; then
      data=$(cd "${2:?--data needs a folder}" && pwd)
      shift 2
    else
      others+=("$1")
      shift
    fi
  done
}

is_installed() {
  [ "$(dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null)" = installed ]
}

# Asks on the terminal; without one the answer is no.
agreed() {
  local answer
  [ "$assume_yes" = yes ] && return 0
  [ -t 0 ] || return 1
  read -r -p "$1 [y/N] " answer
  [[ $answer == [yY]* ]]
}

# Installs the packages in `missing`, behind the given command (sudo) if any. A failed update may be an old list's
# mirror; the installation then shows whether that matters.
apt_install() {
  "$@" env DEBIAN_FRONTEND=noninteractive apt-get update || true
  "$@" env DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends "${missing[@]}"
}

# Installs those of the given packages that are missing. Does not touch apt when none is.
install_missing() {
  local package missing=()
  for package in "$@"; do
    is_installed "$package" || missing+=("$package")
  done
  [ ${#missing[@]} -eq 0 ] && return 0

  echo "Missing packages: ${missing[*]}"
  if [ "$(id -u)" -eq 0 ] && command -v apt-get >/dev/null; then
    apt_install && return 0
  elif command -v sudo >/dev/null && command -v apt-get >/dev/null && agreed "Install them with sudo apt-get?"; then
    apt_install sudo && return 0
  fi
  echo "Install them, then run this script again:" >&2
  echo "  sudo apt-get install -y --no-install-recommends ${missing[*]}" >&2
  exit 1
}

# configure_and_build <preset> [more options for the configuration]: into build/<preset>.
configure_and_build() {
  local preset=$1
  shift
  (cd "$root" && cmake --preset "$preset" "$@" && cmake --build "build/$preset" -j "$jobs")
}

# run_tests <preset> [more options of ctest]: all but those that take long.
run_tests() {
  local preset=$1
  shift
  (cd "$root/build/$preset" && ctest --output-on-failure -j 2 -LE 'long|campaign' "$@")
}

# run_long_tests <preset>: what repeats much for many seconds.
run_long_tests() {
  (cd "$root/build/$1" && ctest --output-on-failure -j 2 -L long)
}

# run_campaigns <preset>: Monte Carlo over many minutes.
run_campaigns() {
  (cd "$root/build/$1" && ctest --output-on-failure -j 2 -L campaign)
}
