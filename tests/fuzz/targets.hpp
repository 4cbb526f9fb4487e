#pragma once

#include <string_view>
#include <vector>

// What is fuzzed: each function takes any bytes, lets InputError pass for what a user may get wrong, and aborts where
// the library breaks a promise. One libFuzzer program each; fuzz_corpus_test runs all of them over tests/fuzz/corpus.
namespace kdl_calibration::fuzzing {

/// A CSV of a robot with two joints; behind a joint convention where it speaks of "J1".
void measurements(std::string_view bytes);
/// A joint convention.
void joint_convention(std::string_view bytes);
/// Known base, known and facing targets, result.
void json_inputs(std::string_view bytes);
/// Options from a TOML or INI file.
void config_file(std::string_view bytes);
/// A URDF: the chain, the model, the export and the export read again.
void urdf(std::string_view bytes);
/// A robot program, in each of the languages that it may be written in.
void programs(std::string_view bytes);
/// Frames of a controller, as a file of each language.
void program_frames(std::string_view bytes);
/// A whole calibration whose robot, measurements and options the bytes change.
void calibration(std::string_view bytes);

struct Target {
  const char* name;  ///< of the program and the folder of its corpus
  void (*run)(std::string_view bytes);
};
inline const std::vector<Target>& targets() {
  static const std::vector<Target> all = {{"measurements", measurements},
                                          {"joint_convention", joint_convention},
                                          {"json_inputs", json_inputs},
                                          {"config_file", config_file},
                                          {"urdf", urdf},
                                          {"programs", programs},
                                          {"program_frames", program_frames},
                                          {"calibration", calibration}};
  return all;
}

}  // namespace kdl_calibration::fuzzing
