// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file json_node.hpp
/// Reading JSON that may be wrong: every value is checked, and messages name the way to it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/json/read_json.hpp"

namespace slicecorr::detail {

/// A value in the text, with the way to it for messages. Throws `InputError` when it is not what is
/// asked for. Refers to the value and the place.
template <class Json>
class JsonNode {
 public:
  JsonNode(const Json& json, std::string path, const JsonSource& place)
      : json_(&json), path_(std::move(path)), place_(&place) {}

  [[noreturn]] void fail(const std::string& expected) const {
    refuse((path_.empty() ? "the file" : path_) + " is " + shown() + ", expected " + expected);
  }

  [[noreturn]] void refuse(const std::string& message) const {
    throw InputError(place_->file, place_->entry, message);
  }

  const Json& json() const { return *json_; }

  bool is_text(const char* text) const { return json_->is_string() && *json_ == text; }

  bool has(const char* key) const { return object().find(key) != object().end(); }

  JsonNode operator[](const char* key) const {
    const auto found = object().find(key);
    if (found == object().end()) {
      refuse(path(key) + " is missing");
    }
    return {*found, path(key), *place_};
  }

  double number(double least, double most) const {
    const double value = json_->is_number() ? json_->template get<double>() : NAN;
    if (!(value >= least && value <= most)) {
      fail(most >= JsonSource::kLargest ? "a number of at least " + text(least)
                                        : "a number from " + text(least) + " to " + text(most));
    }
    return value;
  }

  /// A number above 0.
  double positive(double most = JsonSource::kLargest) const {
    const double value = json_->is_number() ? json_->template get<double>() : NAN;
    if (!(value > 0 && value <= most)) {
      fail(most >= JsonSource::kLargest ? "a number above 0"
                                        : "a number above 0 and up to " + text(most));
    }
    return value;
  }

  /// Some programs write whole numbers with a decimal point.
  std::int64_t whole(std::int64_t least, std::int64_t most) const {
    const double value = json_->is_number() ? json_->template get<double>() : NAN;
    if (!(value >= static_cast<double>(least) && value <= static_cast<double>(most)) ||
        value != std::floor(value)) {
      fail("a whole number from " + std::to_string(least) + " to " + std::to_string(most));
    }
    return static_cast<std::int64_t>(value);
  }
  int integer(int least, int most) const { return static_cast<int>(whole(least, most)); }

  bool flag() const {
    if (!json_->is_boolean()) fail("true or false");
    return json_->template get<bool>();
  }

  std::string string() const {
    if (!json_->is_string()) fail("a text");
    return json_->template get<std::string>();
  }

  /// Index of the text among `choices`.
  std::size_t choice(const std::vector<std::string>& choices) const {
    const auto found = json_->is_string() ? std::find(choices.begin(), choices.end(),
                                                      json_->template get<std::string>())
                                          : choices.end();
    if (found == choices.end()) {
      std::string list;
      for (const auto& c : choices) list += (list.empty() ? "\"" : " or \"") + c + "\"";
      fail(list);
    }
    return static_cast<std::size_t>(found - choices.begin());
  }

  std::vector<JsonNode> list(std::size_t least, std::size_t most) const {
    if (!json_->is_array() || json_->size() < least || json_->size() > most) {
      fail("a list of " + std::to_string(least) + " to " + std::to_string(most) + " entries");
    }
    std::vector<JsonNode> nodes;
    for (std::size_t i = 0; i < json_->size(); ++i) {
      nodes.emplace_back((*json_)[i], path_ + "[" + std::to_string(i) + "]", *place_);
    }
    return nodes;
  }

 private:
  static std::string text(double v) { return Json(v).dump(); }
  std::string path(const char* key) const { return path_.empty() ? key : path_ + "." + key; }

  const Json& object() const {
    if (!json_->is_object()) fail("an object");
    return *json_;
  }

  std::string shown() const {
    if (json_->is_structured()) return json_->is_array() ? "a list" : "an object";
    if (json_->is_string() && json_->template get_ref<const std::string&>().size() > 40)
      return "a long text";
    return json_->dump();
  }

  const Json* json_;
  std::string path_;
  const JsonSource* place_;
};

}  // namespace slicecorr::detail
