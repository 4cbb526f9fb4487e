#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <set>
#include <string>

#include "targets.hpp"

namespace kdl_calibration::fuzzing {
namespace {

class FuzzCorpus : public ::testing::TestWithParam<Target> {};

TEST_P(FuzzCorpus, BreaksNoPromise) {
  // And cut short; a run of `calibration` is a whole calibration.
  const std::size_t cuts = std::string(GetParam().name) == "calibration" ? 2 : 20;
  std::set<std::string> known;  // files begin alike
  const auto run_once = [&](const std::string& bytes) {
    if (known.insert(bytes).second) {
      GetParam().run(bytes);
    }
  };
  int files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::string(CORPUS_DIR) + "/" + GetParam().name)) {
    SCOPED_TRACE(entry.path());
    std::ifstream stream(entry.path(), std::ios::binary);
    const std::string bytes{std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
    run_once(bytes);
    for (std::size_t length = 0; length < bytes.size(); length += 1 + bytes.size() / cuts) {
      run_once(bytes.substr(0, length));
    }
    ++files;
  }
  EXPECT_GT(files, 0);
}

INSTANTIATE_TEST_SUITE_P(All, FuzzCorpus, ::testing::ValuesIn(targets()),
                         [](const auto& target) { return std::string(target.param.name); });

}  // namespace
}  // namespace kdl_calibration::fuzzing
