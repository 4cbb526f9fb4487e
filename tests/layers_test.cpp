// Holds the wings of src/README.md: includes point downwards only.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <regex>
#include <sstream>
#include <string>
#include <vector>

namespace kdl_calibration::testing::layers_test {
namespace {

namespace fs = std::filesystem;

/// From the ground up.
const std::vector<std::string> kWings = {"base",       "robot",     "measurements", "model",       "effects",
                                         "estimation", "two_step",  "noise",        "uncertainty", "validation",
                                         "screening",  "diagnosis", "selection",    "calibration", "results",
                                         "planning",   "interface", "programs",     "cli",         "python"};

/// Public headers without a source of their own.
const std::map<std::string, std::string> kHeadersAlone = {{"version", "base"},
                                                          {"input_error", "base"},
                                                          {"accuracy", "validation"},
                                                          {"calibration_options", "estimation"},
                                                          {"calibrated_arm", "calibration"},
                                                          {"calibration", "calibration"},
                                                          {"measuring_plan", "planning"},
                                                          {"validation", "interface"},
                                                          {"simulation", "interface"},
                                                          {"report_page", "interface"},
                                                          {"calibrate", "interface"},
                                                          {"kdl_calibration", "cli"}};

struct SourceFile {
  std::string path;  // relative to the project
  std::string wing;
  std::string text;
};

std::size_t storey(const std::string& wing) {
  return static_cast<std::size_t>(std::find(kWings.begin(), kWings.end(), wing) - kWings.begin());
}

std::string stem_of(const std::string& include) { return fs::path(include).stem(); }

/// The wing of a public header is that of the source with its stem.
std::map<std::string, std::string> wings_of_public_headers(const std::vector<SourceFile>& files) {
  std::map<std::string, std::string> result = kHeadersAlone;
  for (const SourceFile& file : files) {
    if (!file.wing.empty() && file.wing != "cli" && file.wing != "python" &&
        fs::path(file.path).extension() == ".cpp") {
      result.emplace(stem_of(file.path), file.wing);
    }
  }
  return result;
}

/// What is wrong with one include of a file in `wing`; nothing where it is in order.
std::optional<std::string> broken_rule(const std::string& wing, const std::string& include,
                                       const std::map<std::string, std::string>& public_headers) {
  const std::string folder = fs::path(include).parent_path();
  const bool is_public = folder == "kdl_calibration";
  std::string other = folder;
  if (is_public) {
    const auto found = public_headers.find(stem_of(include));
    if (found == public_headers.end()) {
      return "is the public header of no source, expected src/<wing>/" + stem_of(include) + ".cpp";
    }
    other = found->second;
  }
  if (storey(other) == kWings.size()) {
    return "is in no wing, expected kdl_calibration/<stem>.hpp or <wing>/<stem>.hpp";
  }
  if (storey(other) > storey(wing)) {
    return "points upwards from " + wing + " to " + other;
  }
  return std::nullopt;
}

/// One line for every include that breaks a rule: file, line and rule.
std::vector<std::string> broken_includes(const std::vector<SourceFile>& files) {
  static const std::regex include_line(R"re(^\s*#\s*include\s*"([^"]+)")re");
  const std::map<std::string, std::string> public_headers = wings_of_public_headers(files);
  std::vector<std::string> broken;
  for (const SourceFile& file : files) {
    const auto own = public_headers.find(stem_of(file.path));
    const std::string wing = !file.wing.empty() ? file.wing : own != public_headers.end() ? own->second : "";
    const auto complain = [&](int line, const std::string& what) {
      broken.push_back(file.path + ":" + std::to_string(line) + ": " + what);
    };
    if (storey(wing) == kWings.size()) {
      complain(1, "belongs to no wing");
      continue;
    }
    std::istringstream lines(file.text);
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
      std::smatch match;
      if (std::regex_search(line, match, include_line)) {
        if (const auto rule = broken_rule(wing, match[1], public_headers)) {
          complain(number, match[1].str() + " " + *rule);
        }
      }
    }
  }
  return broken;
}

std::vector<SourceFile> project_files() {
  const fs::path root = PROJECT_DIR;
  std::vector<SourceFile> files;
  for (const char* folder : {"src", "include"}) {
    for (const auto& entry : fs::recursive_directory_iterator(root / folder)) {
      const std::string extension = entry.path().extension();
      if (extension != ".cpp" && extension != ".hpp") {
        continue;
      }
      const fs::path path = entry.path().lexically_relative(root);
      std::ifstream stream(entry.path());
      std::ostringstream text;
      text << stream.rdbuf();
      const bool in_wing = folder == std::string("src") && path.has_parent_path() && path.parent_path() != "src";
      files.push_back({.path = path.string(),
                       .wing = in_wing ? std::next(path.begin())->string() : std::string(),
                       .text = text.str()});
    }
  }
  return files;
}

TEST(Layers, IncludesPointDownwardsOnly) {
  const std::vector<SourceFile> files = project_files();
  ASSERT_GT(files.size(), 50U) << "the sources were not found in " << PROJECT_DIR;
  EXPECT_THAT(broken_includes(files), ::testing::IsEmpty());
}

/// Functions of C that keep something which all threads share.
std::vector<std::string> shared_state(const std::vector<SourceFile>& files) {
  const std::regex call(
      R"((?:std::|[^\w:.>]::|[^\w:.>])(lgamma|strtok|localtime|gmtime|asctime|ctime|rand|srand|setlocale|strerror)\()");
  std::vector<std::string> found;
  for (const SourceFile& file : files) {
    std::istringstream lines(file.text);
    std::string line;
    for (int number = 1; std::getline(lines, line); ++number) {
      std::smatch match;
      if (std::regex_search(line, match, call)) {
        found.push_back(file.path + ":" + std::to_string(number) + ": " + match[1].str());
      }
    }
  }
  return found;
}

TEST(Layers, CallNothingThatThreadsShare) {
  EXPECT_THAT(shared_state(project_files()), ::testing::IsEmpty());
  const SourceFile bad{.path = "src/a.cpp", .wing = "base", .text = "x = 1;\ny = std::lgamma(x) + ::rand();\n"};
  EXPECT_THAT(shared_state({bad}), ::testing::ElementsAre("src/a.cpp:2: lgamma"));
  const SourceFile good{.path = "src/a.cpp", .wing = "base", .text = "y = ::lgamma_r(x, &s); z = robot.rand(3);\n"};
  EXPECT_THAT(shared_state({good}), ::testing::IsEmpty());
}

/// Types of one name that two files define outside unnamed namespaces: no linker tells them apart.
std::vector<std::string> types_defined_twice(const std::vector<SourceFile>& files) {
  const std::regex open(R"(namespace (?:KDL_CALIBRATION_PUBLIC )?(.*)\{)");
  const std::regex definition(R"((?:struct|class|enum class) (\w+)( : .*)? \{.*)");
  std::map<std::string, std::string> places;
  std::vector<std::string> twice;
  for (const SourceFile& file : files) {
    std::vector<std::string> namespaces;
    std::istringstream lines(file.text);
    for (std::string line; std::getline(lines, line);) {
      std::smatch match;
      if (std::regex_match(line, match, open)) {
        namespaces.push_back(match[1].length() == 0 ? file.path : match[1].str());
      } else if (line.starts_with("}  // namespace")) {
        namespaces.pop_back();
      } else if (std::regex_match(line, match, definition)) {
        const std::string scope = namespaces.empty() ? "" : namespaces.back();
        const auto [place, is_new] = places.emplace(scope + match[1].str(), file.path);
        if (!is_new) {
          twice.push_back(match[1].str() + " in " + place->second + " and " + file.path);
        }
      }
    }
  }
  return twice;
}

TEST(Layers, DefineEachTypeOnce) {
  EXPECT_THAT(types_defined_twice(project_files()), ::testing::IsEmpty());
  const SourceFile one{
      .path = "a.hpp", .wing = "base", .text = "namespace k {\nstruct A {\n};\nstruct B;\n}  // namespace k\n"};
  const SourceFile two{
      .path = "b.hpp", .wing = "base", .text = "namespace k {\nclass A : X {\n};\nclass B {\n};\n}  // namespace k\n"};
  const SourceFile own{.path = "c.cpp",
                       .wing = "base",
                       .text = "namespace k {\nnamespace {\nstruct A {\n};\n}  // namespace\n}  // namespace k\n"};
  EXPECT_THAT(types_defined_twice({one, two, own}), ::testing::ElementsAre("A in a.hpp and b.hpp"));
}

TEST(Layers, NoticesWhatIsForbidden) {
  const std::string plan = "kdl_calibration/measuring_plan.hpp";
  struct Case {
    std::string path;
    std::string wing;
    std::string include;
    std::string complaint;  // behind the path; empty: none
  };
  for (const Case& c : std::vector<Case>{
           {"src/model/a.cpp", "model", plan, ":2: " + plan + " points upwards from model to planning"},
           {"include/kdl_calibration/kinematics.hpp", "", plan,
            ":2: " + plan + " points upwards from model to planning"},
           {"src/model/a.cpp", "model", "planning/own.hpp",
            ":2: planning/own.hpp points upwards from model to planning"},
           {"src/planning/a.cpp", "planning", "kdl_calibration/nothing.hpp",
            ":2: kdl_calibration/nothing.hpp is the public header of no source, expected src/<wing>/nothing.cpp"},
           {"src/planning/a.cpp", "planning", "nothing.hpp",
            ":2: nothing.hpp is in no wing, expected kdl_calibration/<stem>.hpp or <wing>/<stem>.hpp"},
           {"src/stray.cpp", "", "base/median.hpp", ":1: belongs to no wing"},
           {"src/planning/a.cpp", "planning", "model/own.hpp", ""},
           {"src/planning/a.cpp", "planning", "planning/own.hpp", ""},
           {"src/planning/a.cpp", "planning", "base/median.hpp", ""},
           {"src/planning/a.cpp", "planning", "kdl_calibration/kinematics.hpp", ""}}) {
    const std::vector<std::string> complaints =
        broken_includes({{.path = c.path, .wing = c.wing, .text = "// first line\n#include \"" + c.include + "\"\n"},
                         {.path = "src/planning/simulation.cpp", .wing = "planning", .text = ""},
                         {.path = "src/model/kinematics.cpp", .wing = "model", .text = ""}});
    const std::vector<std::string> expected(c.complaint.empty() ? 0 : 1, c.path + c.complaint);
    EXPECT_EQ(complaints, expected);
  }
}

}  // namespace
}  // namespace kdl_calibration::testing::layers_test
