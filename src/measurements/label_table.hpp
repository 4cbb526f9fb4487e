#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <utility>
#include <vector>

namespace kdl_calibration {

/// Numbers labels in the order of their first appearance.
class LabelTable {
public:
  LabelTable() : index_(16, Hash{&labels_}, Equal{&labels_}) {}
  LabelTable(const LabelTable&) = delete;
  LabelTable& operator=(const LabelTable&) = delete;

  /// The number of the label, or the size of the table for a new one.
  /// Labels usually appear in order, so the last one and its successor are tried before the hash.
  std::int32_t find(std::string_view label) {
    const std::int32_t next = last_ + 1 < size() ? last_ + 1 : 0;
    for (const std::int32_t guess : {last_, next}) {
      if (guess < size() && labels_[static_cast<std::size_t>(guess)] == label) return last_ = guess;
    }
    const auto found = index_.find(label);
    return found == index_.end() ? size() : last_ = *found;
  }

  void add(std::string_view label) {
    last_ = size();
    labels_.emplace_back(label);
    index_.insert(last_);
  }

  std::int32_t size() const { return static_cast<std::int32_t>(labels_.size()); }
  const std::vector<std::string>& labels() const { return labels_; }

  /// The labels; leaves the table empty.
  std::vector<std::string> take_labels() {
    index_ = Index(0, Hash{&labels_}, Equal{&labels_});
    last_ = 0;
    return std::exchange(labels_, {});
  }

private:
  // The set stores indices only, so that each label is stored once.
  struct Hash {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    std::size_t operator()(std::string_view label) const { return std::hash<std::string_view>()(label); }
    std::size_t operator()(std::int32_t i) const { return (*this)((*labels)[static_cast<std::size_t>(i)]); }
  };
  struct Equal {
    using is_transparent = void;
    const std::vector<std::string>* labels;
    bool operator()(std::int32_t a, std::int32_t b) const { return a == b; }
    bool operator()(std::string_view a, std::int32_t b) const { return a == (*labels)[static_cast<std::size_t>(b)]; }
    bool operator()(std::int32_t a, std::string_view b) const { return (*this)(b, a); }
  };

  using Index = std::unordered_set<std::int32_t, Hash, Equal>;

  std::vector<std::string> labels_;
  Index index_;
  std::int32_t last_ = 0;
};

}  // namespace kdl_calibration
