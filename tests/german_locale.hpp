#pragma once

#include <clocale>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <locale>
#include <string>

/// What glibc keeps of LOCPATH is no leak of ours.
extern "C" __attribute__((weak)) const char* __lsan_default_suppressions() {  // NOLINT
  return "leak:__argz_add_sep";
}

namespace kdl_calibration::testing {

/// A folder for LOCPATH with a locale `de_DE` in it that has a decimal comma, made by localedef; false where that
/// fails. The whole of glibc's de_DE would take seconds.
class GermanLocaleFolder {
public:
  GermanLocaleFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "german_XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
    std::string definition = "LC_NUMERIC\ndecimal_point \",\"\nthousands_sep \".\"\ngrouping 3;3\nEND LC_NUMERIC\n";
    for (const char* category : {"LC_CTYPE", "LC_COLLATE", "LC_TIME", "LC_MONETARY", "LC_MESSAGES"}) {
      definition += std::string(category) + "\ncopy \"POSIX\"\nEND " + category + "\n";
    }
    const std::filesystem::path source = path_ / "comma";
    std::ofstream(source) << definition;
    // Fails for the categories that are left out, and makes the others all the same.
    const std::string command =
        "localedef -c -f ISO-8859-1 -i '" + source.string() + "' '" + (path_ / "de_DE").string() + "' > /dev/null 2>&1";
    made_ = std::system(command.c_str()) >= 0 && std::filesystem::exists(path_ / "de_DE" / "LC_NUMERIC");
  }
  ~GermanLocaleFolder() { std::filesystem::remove_all(path_); }
  GermanLocaleFolder(const GermanLocaleFolder&) = delete;
  GermanLocaleFolder& operator=(const GermanLocaleFolder&) = delete;

  explicit operator bool() const { return made_; }
  const std::filesystem::path& path() const { return path_; }

private:
  std::filesystem::path path_;
  bool made_ = false;
};

/// A program under that locale while it lives: both C's locale, which strtod and printf follow, and the streams'.
class UnderAComma {
public:
  explicit UnderAComma(const GermanLocaleFolder& german) {
    ::setenv("LOCPATH", german.path().c_str(), 1);
    before_ = std::locale::global(std::locale("de_DE"));
  }
  ~UnderAComma() {
    std::locale::global(before_);
    std::setlocale(LC_ALL, "C");
    ::unsetenv("LOCPATH");
  }
  UnderAComma(const UnderAComma&) = delete;
  UnderAComma& operator=(const UnderAComma&) = delete;

private:
  std::locale before_;
};

}  // namespace kdl_calibration::testing
