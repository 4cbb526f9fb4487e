#pragma once

#include <string>
#include <vector>

#include "programs/rapid_modules.hpp"

namespace kdl_calibration::rapid {

/// The place that a value states: [[x,y,z],[q1,q2,q3,q4],[cf1,cf4,cf6,cfx],[eax_a,...,eax_f]], or
/// [[rax_1,...,rax_6],[eax_a,...,eax_f]] for a jointtarget. `name` is for messages; throws InputError through `words`.
Place place_of(const Value& value, Type type, const std::string& name, const Words& words);

/// The frame of [robhold,tframe,tload], or of [robhold,ufprog,ufmec,uframe,oframe] for wobjdata.
Frame frame_of(const Value& value, Type type, const std::string& name, const Words& words);

/// [cf1,cf4,cf6,cfx]; none where a member is computed.
std::optional<Configuration> configuration_of(const Value& value, const std::string& name, const Words& words);

/// [eax_a,...,eax_f] without the axes that are not there (9E9); none where a member is computed.
std::optional<std::vector<ExternalValue>> external_of(const Value& value, const std::string& name, const Words& words);

}  // namespace kdl_calibration::rapid
