#include "python/options.hpp"

#include <fmt/core.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <functional>
#include <type_traits>
#include <utility>

#include "kdl_calibration/input_error.hpp"
#include "python/arrays.hpp"
#include "python/file_names.hpp"

namespace kdl_calibration::python {
namespace {

// The type in words.
template <class T>
const char* expected() {
  if constexpr (std::is_same_v<T, bool> || std::is_same_v<T, std::optional<bool>>) {
    return "True or False";
  } else if constexpr (std::is_integral_v<T> || std::is_same_v<T, std::optional<int>>) {
    return "an integer";
  } else if constexpr (std::is_same_v<T, double> || std::is_same_v<T, std::optional<double>>) {
    return "a number";
  } else if constexpr (std::is_same_v<T, std::string>) {
    return "a text";
  } else if constexpr (std::is_same_v<T, std::optional<std::filesystem::path>>) {
    return "a file, a text or os.PathLike";
  } else if constexpr (std::is_same_v<T, std::optional<std::variant<std::filesystem::path, JointConvention>>>) {
    return "a JointConvention, or its file";
  } else if constexpr (std::is_same_v<T, std::vector<std::string>>) {
    return "a list of texts";
  } else if constexpr (std::is_same_v<T, std::shared_ptr<const Found>>) {
    return "a Calibration";
  } else {
    return "an object of the package";
  }
}

// Reads a value from Python. `where` names the option in messages.
template <class T>
void take(const py::handle& given, T& into, const std::string& where) {
  constexpr bool kIsBool = std::is_same_v<T, bool> || std::is_same_v<T, std::optional<bool>>;
  try {
    if (kIsBool && !given.is_none() && !py::isinstance<py::bool_>(given) &&
        !py::isinstance(given, py::module_::import("numpy").attr("bool_"))) {
      throw py::cast_error();
    }
    into = given.cast<T>();
  } catch (const py::cast_error&) {
    throw py::type_error(fmt::format("{}: {}, expected {}", where, std::string(py::repr(given)), expected<T>()));
  }
}

// The members of a structure, by name.
class Members {
public:
  using Reader = std::function<void(const py::handle&, const std::string& where)>;

  template <class T>
  Members& with(const char* name, T& into) {
    return by(name, [&into](const py::handle& given, const std::string& where) { take(given, into, where); });
  }
  Members& by(const char* name, Reader reader) {
    readers_.emplace_back(name, std::move(reader));
    return *this;
  }
  /// Reads a dict.
  void read(const py::handle& given, const std::string& where) const {
    if (!py::isinstance<py::dict>(given)) {
      throw py::type_error(where + ": " + std::string(py::repr(given)) + ", expected a dict of " + names(where));
    }
    const std::string prefix = where.empty() ? "" : where + ".";
    for (const auto& [key, value] : py::reinterpret_borrow<py::dict>(given)) {
      const std::string name = py::str(key);
      const auto found = std::find_if(readers_.begin(), readers_.end(),
                                      [&name = name](const auto& reader) { return reader.first == name; });
      if (found == readers_.end()) {
        throw py::type_error("unknown option " + prefix + name + ", expected one of " + names(where));
      }
      found->second(value, prefix + name);
    }
  }

private:
  std::string names(const std::string& where) const {
    std::string all;
    for (const auto& [name, reader] : readers_) {
      all += (all.empty() ? "" : ", ") + (where.empty() ? "" : where + ".") + name;
    }
    return all;
  }

  std::vector<std::pair<std::string, Reader>> readers_;
};

template <class T>
using Words = std::vector<std::pair<const char*, T>>;

// One of several words.
template <class T>
T word(const py::handle& given, const Words<T>& words, const std::string& where) {
  std::string text;
  take(given, text, where);
  std::string all;
  for (const auto& [name, value] : words) {
    if (text == name) {
      return value;
    }
    all += (all.empty() ? "'" : ", '") + std::string(name) + "'";
  }
  throw py::value_error(where + ": '" + text + "', expected one of " + all);
}

template <class T>
Members::Reader one_of(T& into, Words<T> words) {
  return [&into, words = std::move(words)](const py::handle& given, const std::string& where) {
    into = word(given, words, where);
  };
}

Members::Reader function_into(py::object& into) {
  return [&into](const py::handle& given, const std::string& where) {
    if (!given.is_none() && PyCallable_Check(given.ptr()) == 0) {
      throw py::type_error(where + ": " + std::string(py::repr(given)) + ", expected a function");
    }
    into = py::reinterpret_borrow<py::object>(given);
  };
}

Members::Reader vector_into(Eigen::Vector3d& into) {
  return [&into](const py::handle& given, const std::string& where) { into = vector3(given, where); };
}

// A vector, or one number for all three axes.
Members::Reader axes_into(Eigen::Vector3d& into) {
  return [&into](const py::handle& given, const std::string& where) {
    const Doubles array = doubles(given, where);
    into = array.ndim() == 0 ? Eigen::Vector3d(Eigen::Vector3d::Constant(*array.data())) : vector3(given, where);
  };
}

Members::Reader targets_into(std::vector<TargetFrame>& into) {
  return [&into](const py::handle& given, const std::string& where) { into = target_frames(given, where); };
}

Members::Reader frames_into(KnownFrames& into) {
  return [&into](const py::handle& given, const std::string& where) {
    Members()
        .by("bases",
            [&](const py::handle& bases, const std::string& place) {
              if (!py::isinstance<py::dict>(bases)) {
                throw py::type_error(place + ": " + std::string(py::repr(bases)) +
                                     ", expected a dict of stations and poses (4, 4)");
              }
              for (const auto& [name, X_WB] : py::reinterpret_borrow<py::dict>(bases)) {
                const std::string station = py::str(name);
                into.bases.push_back({.station = station, .X_WB = pose(X_WB, place + "." + station)});
              }
            })
        .by("targets", targets_into(into.targets))
        .read(given, where);
  };
}

Members::Reader ranges_into(JointRanges& into) {
  return [&into](const py::handle& given, const std::string& where) {
    const Doubles array = doubles(given, where);
    if (array.ndim() != 2 || array.shape(1) != 2) {
      throw py::value_error(where + ": an array of shape " + std::string(py::str(array.attr("shape"))) +
                            ", expected (n, 2)");
    }
    for (py::ssize_t i = 0; i < array.shape(0); ++i) {
      into.emplace_back(array.at(i, 0), array.at(i, 1));
    }
  };
}

Members::Reader noise_into(NoiseModel& into) {
  return [&into](const py::handle& given, const std::string& where) {
    Members()
        .by("independent", axes_into(into.independent))
        .by("tracker",
            [&](const py::handle& numbers, const std::string& place) {
              TrackerNoise& tracker = into.tracker.emplace();
              Members()
                  .with("range", tracker.range)
                  .with("range_per_metre", tracker.range_per_metre)
                  .with("transverse", tracker.transverse)
                  .with("transverse_per_metre", tracker.transverse_per_metre)
                  .read(numbers, place);
            })
        .by("common", axes_into(into.common))
        .with("misfit", into.misfit)
        .with("target_misfit", into.target_misfit)
        .with("orientation", into.orientation)
        .read(given, where);
  };
}

const Words<EffectGroup> kGroups = {
    {"gravity", EffectGroup::gravity},     {"transverse", EffectGroup::transverse}, {"gain", EffectGroup::gain},
    {"backlash", EffectGroup::backlash},   {"harmonics", EffectGroup::harmonics},   {"ripple", EffectGroup::ripple},
    {"tables", EffectGroup::tables},       {"torque", EffectGroup::torque},         {"coupling", EffectGroup::coupling},
    {"expansion", EffectGroup::expansion}, {"drift", EffectGroup::drift},           {"payload", EffectGroup::payload}};

Members::Reader groups_into(std::vector<EffectGroup>& into) {
  return [&into](const py::handle& given, const std::string& where) {
    std::vector<std::string> names;
    take(given, names, where);
    into.clear();
    for (const std::string& name : names) {
      into.push_back(word(py::str(name), kGroups, where));
    }
  };
}

// A function of the caller's own, called from any thread.
std::shared_ptr<const py::object> shared_function(const py::handle& given, const std::string& where) {
  if (PyCallable_Check(given.ptr()) == 0) {
    throw py::type_error(where + ": " + std::string(py::repr(given)) + ", expected a function of joint values (N, n)");
  }
  return {new py::object(py::reinterpret_borrow<py::object>(given)), [](const py::object* object) {
            const py::gil_scoped_acquire lock;
            delete object;  // NOLINT(cppcoreguidelines-owning-memory)
          }};
}

// N x K of an array (N,) or (N, K).
Eigen::MatrixXd rows_of_columns(const Doubles& values, const std::string& where) {
  if (values.ndim() != 1 && values.ndim() != 2) {
    throw py::value_error(where + ": an array of shape " + std::string(py::str(values.attr("shape"))) +
                          ", expected (N,) or (N, K)");
  }
  const py::ssize_t columns = values.ndim() == 2 ? values.shape(1) : 1;
  using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  return Eigen::Map<const RowMajor>(values.data(), values.shape(0), columns);
}

// Joint values (n x N) as an array (N, n).
Doubles a_row_each(const Eigen::MatrixXd& joint_values) {
  Doubles q({joint_values.cols(), joint_values.rows()});
  std::copy_n(joint_values.data(), joint_values.size(), q.mutable_data());
  return q;
}

// Of joint values (N, n), which gives (N,) or (N, K).
OwnColumns columns_by(const py::handle& given, const std::string& where) {
  const std::shared_ptr<const py::object> function = shared_function(given, where);
  return [function, where](const Eigen::MatrixXd& joint_values) -> Eigen::MatrixXd {
    const py::gil_scoped_acquire lock;
    return rows_of_columns(doubles((*function)(a_row_each(joint_values)), where), where);
  };
}

Members::Reader own_into(GivenCalibrationOptions& into) {
  return [&into](const py::handle& given, const std::string& where) {
    into.options.effects.own = own_effects(given, where);
    into.own = copy_of_effects(py::reinterpret_borrow<py::dict>(given));
  };
}

Members::Reader configurations_into(Configurations& into) {
  return [&into](const py::handle& given, const std::string& where) {
    Members()
        .with("names", into.names)
        .by("joint_values",
            [&](const py::handle& values, const std::string& place) {
              const Doubles array = doubles(values, place);
              if (array.ndim() != 2) {
                throw py::value_error(place + ": expected an array (N, n)");
              }
              into.joint_values = Rows(array, static_cast<std::size_t>(array.shape(1)), place).transposed();
            })
        .read(given, where);
  };
}

// The members of `options` under the name of the structure that holds them.
Members::Reader structure(Members members) {
  return
      [members = std::move(members)](const py::handle& given, const std::string& where) { members.read(given, where); };
}

// Calls a function of joint values with (N, n). What it raises becomes the cause of an InputError that names it.
Doubles called(const py::object& function, const Eigen::MatrixXd& joint_values, const std::string& where) {
  const Doubles q = a_row_each(joint_values);
  try {
    return doubles(function(q), where);
  } catch (py::error_already_set& error) {
    if (!error.matches(PyExc_Exception)) {
      throw;
    }
    const std::string kind = py::str(error.type().attr("__name__"));
    const std::string message = where + " raised " + kind + ": " + std::string(py::str(error.value()));
    py::raise_from(error, py::module_::import("kdl_calibration").attr("InputError").ptr(), message.c_str());
    throw py::error_already_set();
  }
}

// Of joint values (N, n), which gives displacements (N, 3) or (N, K, 3).
OwnColumns displacements_by(const py::handle& given, const std::string& where) {
  const std::shared_ptr<const py::object> function = shared_function(given, where);
  return [function, where](const Eigen::MatrixXd& joint_values) -> Eigen::MatrixXd {
    const py::gil_scoped_acquire lock;
    const Doubles values = called(*function, joint_values, where);
    const py::ssize_t dimensions = values.ndim();
    if ((dimensions != 2 && dimensions != 3) || values.shape(dimensions - 1) != 3) {
      throw InputError(where + ": an array of shape " + std::string(py::str(values.attr("shape"))) +
                       ", expected displacements (N, 3) or (N, K, 3), or a joint that moves by (N,) or (N, K)");
    }
    using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    return Eigen::Map<const RowMajor>(values.data(), values.shape(0),
                                      dimensions == 3 ? 3 * values.shape(1) : Eigen::Index{3});
  };
}

// Of joint values (N, n), which gives motions of a joint (N,) or (N, K).
OwnColumns motions_by(const py::handle& given, const std::string& where) {
  const std::shared_ptr<const py::object> function = shared_function(given, where);
  return [function, where](const Eigen::MatrixXd& joint_values) -> Eigen::MatrixXd {
    const py::gil_scoped_acquire lock;
    return rows_of_columns(called(*function, joint_values, where), where);
  };
}

const Words<EffectAxis> kAxes = {
    {"own", EffectAxis::own}, {"x", EffectAxis::across_x}, {"y", EffectAxis::across_y}, {"along", EffectAxis::along}};

// A dict of names and {'function': …, 'joint': …, 'axis': …} or {'function': …, 'frame': …}.
Members::Reader alternatives_into(std::vector<OwnAlternative>& into) {
  return [&into](const py::handle& given, const std::string& where) {
    if (!py::isinstance<py::dict>(given)) {
      throw py::type_error(where + ": " + std::string(py::repr(given)) +
                           ", expected a dict of names and alternatives {'function': …}");
    }
    into.clear();
    for (const auto& [key, value] : py::reinterpret_borrow<py::dict>(given)) {
      OwnAlternative alternative{.name = py::str(key)};
      const std::string place = where + "." + alternative.name;
      std::optional<py::handle> function;
      std::optional<EffectAxis> axis;
      std::optional<DisplacementFrame> frame;
      Members()
          .by("function", [&](const py::handle& object, const std::string&) { function = object; })
          .with("joint", alternative.joint)
          .by("axis", [&](const py::handle& text, const std::string& of) { axis = word(text, kAxes, of); })
          .by("frame",
              [&](const py::handle& text, const std::string& of) {
                frame = word(text,
                             Words<DisplacementFrame>{{"measuring", DisplacementFrame::measuring},
                                                      {"base", DisplacementFrame::base}},
                             of);
              })
          .read(value, place);
      if (!function) {
        throw py::type_error(place + ": no function, expected one of joint values");
      }
      const bool moves_joint = !alternative.joint.empty();
      if (moves_joint ? frame.has_value() : axis.has_value()) {
        throw py::type_error(place + (moves_joint ? ": a frame beside a joint, expected one of the two"
                                                  : ": an axis without a joint, expected the name of a joint as well"));
      }
      alternative.axis = axis.value_or(EffectAxis::own);
      alternative.frame = frame.value_or(DisplacementFrame::measuring);
      alternative.columns =
          moves_joint ? motions_by(*function, place + ".function") : displacements_by(*function, place + ".function");
      into.push_back(std::move(alternative));
    }
  };
}

Members diagnosis_members(DiagnosisOptions& options) {
  return Members()
      .by("alternatives", alternatives_into(options.alternatives))
      .with("try_readings", options.try_readings)
      .with("convention", options.convention)
      .with("other_conventions", options.other_conventions);
}

// `kept` keeps it alive.
Members::Reader calibration_into(std::shared_ptr<const Found>& kept, const Calibration*& into) {
  return [&](const py::handle& given, const std::string& where) {
    take(given, kept, where);
    into = kept ? &kept->calibration : nullptr;
  };
}

Members prior_members(GivenCalibrationOptions& into) {
  PriorOptions& priors = into.options.priors;
  return Members()
      .by("stated", structure(Members().with("length", priors.stated.length).with("angle", priors.stated.angle)))
      .with("automatic", priors.automatic)
      .by("earlier", calibration_into(into.earlier, priors.earlier));
}

// A dict of poses (4, 4) by their names.
Members::Reader centres_into(std::map<double, Eigen::Vector3d>& into) {
  return [&into](const py::handle& given, const std::string& where) {
    if (!py::isinstance<py::dict>(given)) {
      throw py::type_error(where + ": " + std::string(py::repr(given)) +
                           ", expected a dict of masses and centres (3,)");
    }
    for (const auto& [key, centre] : py::reinterpret_borrow<py::dict>(given)) {
      double mass = 0.0;
      take(key, mass, where);
      vector_into(into[mass])(centre, where + "." + std::string(py::str(key)));
    }
  };
}

Members::Reader poses_into(std::map<std::string, Eigen::Isometry3d>& into) {
  return [&into](const py::handle& given, const std::string& where) {
    if (!py::isinstance<py::dict>(given)) {
      throw py::type_error(where + ": " + std::string(py::repr(given)) + ", expected a dict of names and poses (4, 4)");
    }
    for (const auto& [name, frame] : py::reinterpret_borrow<py::dict>(given)) {
      const std::string key = py::str(name);
      into[key] = pose(frame, where + "." + key);
    }
  };
}

// Their file, or a dict.
Members::Reader program_frames_into(GivenProgram& into) {
  return [&into](const py::handle& given, const std::string& where) {
    if (py::isinstance<py::dict>(given)) {
      Members()
          .by("user_frames", poses_into(into.frames.user))
          .by("tool_frames", poses_into(into.frames.tool))
          .read(given, where);
    } else {
      take(given, into.frames_file, where);
    }
  };
}

void require_held_out(const ValidationOptions& options) {
  if (!options.held_out && (options.leave_one_out || options.nested || options.k_fold != 0)) {
    throw InputError("validation.held_out: False beside leave_one_out, nested or k_fold, expected one of the two");
  }
}

Members compensation_members(CompensationOptions& options) {
  Members members;
  members.with("most_change", options.most_change)
      .with("position_first", options.position_first)
      .with("held", options.held);
  return members;
}

}  // namespace

std::vector<TargetFrame> target_frames(const py::handle& given, const std::string& where) {
  if (!py::isinstance<py::dict>(given)) {
    throw py::type_error(where + ": expected a dict of names and positions (3,) or poses (4, 4)");
  }
  std::vector<TargetFrame> targets;
  for (const auto& [key, value] : py::reinterpret_borrow<py::dict>(given)) {
    TargetFrame target{.name = py::str(key)};
    const std::string place = where + "." + target.name;
    target.with_orientation = doubles(value, place).ndim() == 2;
    if (target.with_orientation) {
      target.X_FT = pose(value, place);
    } else {
      target.X_FT.translation() = vector3(value, place);
    }
    targets.push_back(std::move(target));
  }
  return targets;
}

std::vector<OwnEffect> own_effects(const py::handle& given, const std::string& where) {
  if (!py::isinstance<py::dict>(given)) {
    throw py::type_error(where + ": expected a dict of names and effects {'joint': …, 'function': …}");
  }
  std::vector<OwnEffect> effects;
  for (const auto& [key, value] : py::reinterpret_borrow<py::dict>(given)) {
    OwnEffect effect{.name = py::str(key)};
    Members()
        .with("joint", effect.joint)
        .by("axis", one_of(effect.axis, kAxes))
        .by("function",
            [&](const py::handle& function, const std::string& place) { effect.columns = columns_by(function, place); })
        .read(value, where + "." + effect.name);
    if (!effect.columns) {
      throw py::type_error(where + "." + effect.name + ": no function, expected one of joint values");
    }
    if (effect.joint.empty()) {
      throw py::type_error(where + "." + effect.name + ": no joint, expected the name of the one that it moves");
    }
    effects.push_back(std::move(effect));
  }
  return effects;
}

py::dict copy_of_effects(const py::dict& own) {
  py::dict copy;
  for (const auto& [name, effect] : own) {
    copy[name] = effect.attr("copy")();
  }
  return copy;
}

GivenCalibrationOptions calibration_options(const py::dict& keywords) {
  GivenCalibrationOptions result;
  CalibrationOptions& options = result.options;
  Members()
      .by("estimator",
          structure(Members()
                        .by("method", one_of(options.estimator.method,
                                             {{"joint", Method::joint}, {"two_step", Method::two_step}}))
                        .with("iterations", options.estimator.iterations)
                        .by("loss", one_of(options.estimator.loss,
                                           {{"none", Loss::none}, {"huber", Loss::huber}, {"tukey", Loss::tukey}}))))
      .by("parameters",
          structure(Members()
                        .by("model", one_of(options.parameters.model, {{"irreducible", ModelChoice::irreducible},
                                                                       {"complete", ModelChoice::complete}}))
                        .with("fix", options.parameters.fix)
                        .with("free", options.parameters.free)
                        .by("keep_axes", one_of(options.parameters.keep_axes, {{"none", KeptAxes::none},
                                                                               {"closed_form", KeptAxes::closed_form},
                                                                               {"angles", KeptAxes::angles}}))
                        .by("known", frames_into(options.parameters.known))))
      .by("priors", structure(prior_members(result)))
      .by("effects", structure(Members()
                                   .by("groups", groups_into(options.effects.groups))
                                   .with("automatic", options.effects.automatic)
                                   .by("payload_centre", vector_into(options.effects.payload_centre))
                                   .by("payload_centres", centres_into(options.effects.payload_centres))
                                   .by("own", own_into(result))
                                   .by("gravity_direction", vector_into(options.effects.gravity_direction))))
      .by("noise", structure(Members()
                                 .by("stated", noise_into(options.noise.stated))
                                 .by("weights", one_of(options.noise.weights, {{"automatic", Weights::automatic},
                                                                               {"equal", Weights::equal},
                                                                               {"repeats", Weights::repeats}}))
                                 .with("scale_sigma", options.noise.scale_sigma)
                                 .with("length_sigma", options.noise.length_sigma)))
      .by("validation", structure(Members()
                                      .with("leave_one_out", options.validation.leave_one_out)
                                      .with("nested", options.validation.nested)
                                      .with("k_fold", options.validation.k_fold)
                                      .with("held_out", options.validation.held_out)))
      .by("diagnosis", structure(diagnosis_members(options.diagnosis)))
      .by("predict_at", configurations_into(options.predict_at))
      .with("threads", options.threads)
      .by("progress", function_into(result.progress))
      .read(keywords, "");
  require_held_out(options.validation);
  return result;
}

GivenPlanOptions plan_options(const py::dict& keywords) {
  GivenPlanOptions result;
  PlanOptions& options = result.options;
  Members()
      .with("count", options.count)
      .by("targets", targets_into(options.targets))
      .by("ranges", ranges_into(options.ranges))
      .with("noise", options.noise)
      .with("least_height", options.least_height)
      .with("least_radius", options.least_radius)
      .with("seed", options.seed)
      .by("after", calibration_into(result.after, options.after))
      .with("suspect", options.suspect)
      .by("progress", function_into(result.progress))
      .read(keywords, "");
  return result;
}

SimulationOptions simulation_options(const py::dict& keywords) {
  SimulationOptions options;
  Members()
      .with("configurations", options.configurations)
      .with("test_configurations", options.test_configurations)
      .by("targets", targets_into(options.targets))
      .by("ranges", ranges_into(options.ranges))
      .with("noise", options.noise)
      .with("repeats", options.repeats)
      .with("length_error", options.length_error)
      .with("angle_error", options.angle_error)
      .with("seed", options.seed)
      .read(keywords, "");
  return options;
}

CompensationOptions compensation_options(const py::dict& keywords) {
  CompensationOptions options;
  compensation_members(options).read(keywords, "");
  return options;
}

GivenProgram program_options(const py::dict& keywords) {
  GivenProgram given;
  compensation_members(given.options)
      .with("controller", given.controller)
      .with("joint_convention", given.joint_convention)
      .by("frames", program_frames_into(given))
      .by("external_axes",
          [&](const py::handle& axes, const std::string& where) {
            if (!py::isinstance<py::dict>(axes)) {
              throw py::type_error(where + ": " + std::string(py::repr(axes)) + ", expected a dict of axes and joints");
            }
            given.external_axes = py::reinterpret_borrow<py::dict>(axes);
          })
      .with("near", given.near)
      .with("line_tolerance", given.line_tolerance)
      .read(keywords, "");
  return given;
}

GivenValidation validation_options(const py::dict& keywords) {
  GivenValidation result;
  Members()
      .by("known", frames_into(result.known))
      .by("diagnosis", structure(diagnosis_members(result.diagnosis)))
      .by("progress", function_into(result.progress))
      .read(keywords, "");
  return result;
}

}  // namespace kdl_calibration::python
