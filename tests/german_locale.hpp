#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace kdl_calibration::testing {

/// A folder for LOCPATH with de_DE.UTF-8 (decimal comma) in it, made by localedef; false where that fails.
class GermanLocaleFolder {
public:
  GermanLocaleFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "german_XXXXXX").string();
    path_ = ::mkdtemp(pattern.data());
    const std::string locale = (path_ / "de_DE.UTF-8").string();
    made_ = std::system(("localedef -i de_DE -f UTF-8 '" + locale + "' > /dev/null 2>&1").c_str()) == 0;
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

}  // namespace kdl_calibration::testing
