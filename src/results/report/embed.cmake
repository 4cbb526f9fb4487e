# Writes a C++ source that holds the page, its style and its script byte for byte:
#   cmake -D folder=<this folder> -D scripts=<a;b;c> -D output=<file> -P embed.cmake
set(code "// Made from src/results/report by embed.cmake.\n#include \"results/report_files.hpp\"\n\n")
string(APPEND code "namespace kdl_calibration {\nnamespace {\n\n")

function(embed name)
  set(bytes "")
  foreach(file IN LISTS ARGN)
    file(READ "${folder}/${file}" hex HEX)
    string(APPEND bytes "${hex}")
  endforeach()
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${bytes}")
  string(APPEND code "constexpr char ${name}[] = {${bytes}'\\0'};\n")
  set(code "${code}" PARENT_SCOPE)
endfunction()

embed(kHtml page.html)
embed(kStyle page.css)
embed(kScript ${scripts})
string(APPEND code "\n}  // namespace\n\n"
                   "std::string_view report_html() { return {kHtml, sizeof kHtml - 1}; }\n"
                   "std::string_view report_style() { return {kStyle, sizeof kStyle - 1}; }\n"
                   "std::string_view report_script() { return {kScript, sizeof kScript - 1}; }\n\n"
                   "}  // namespace kdl_calibration\n")
file(WRITE "${output}" "${code}")
