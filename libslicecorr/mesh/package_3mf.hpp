// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// The zip of a 3MF, distrusted: its parts, and how they point to each other.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "mesh/mesh_module.hpp"

struct zip;

namespace slicecorr::detail {

/// Elements in each other that a text of a 3MF may have.
inline constexpr std::size_t kMost3mfDepth = 64;

/// Checks all sizes that the archive promises before anything is unpacked. Names of parts are those
/// of the zip, "3D/3dmodel.model", in any case.
class Package3mf {
 public:
  struct Relation {
    std::string type, target;  ///< the target is a part of the package
  };

  /// `bytes` must outlive this. Throws `InputError`.
  Package3mf(std::string_view bytes, const std::string& path);
  Package3mf(const Package3mf&) = delete;
  Package3mf& operator=(const Package3mf&) = delete;
  ~Package3mf();

  bool has(std::string_view part) const { return find(part) != nullptr; }
  /// Where `target` leads that is named in `part`: absolute, or beside it. Throws `InputError` where
  /// it leaves the package, or there is no such part.
  std::string resolve(std::string_view target, const std::string& part) const;
  /// Where a part points to; an empty name stands for the package. None where it says nothing.
  std::vector<Relation> relations(const std::string& part) const;
  /// The part with the model that is printed.
  std::string model_part() const;
  /// The parts whose names begin and end so, as the archive spells them.
  std::vector<std::string> parts(std::string_view begin, std::string_view end) const;
  /// Reads a part's XML. Throws `InputError`, with the part and line, where it is none.
  void read_xml(const std::string& part, XmlSink& sink) const;

 private:
  struct Part {
    std::string name;
    std::uint64_t index = 0, bytes = 0;
  };
  const Part* find(std::string_view part) const;

  const std::string& path_;
  zip* zip_ = nullptr;
  std::map<std::string, Part> parts_;  ///< by their names in lower case
};

/// What all readers of XML in a 3MF share: its place in errors, a bound of depth, attributes.
class Xml3mf : public XmlSink {
 public:
  Xml3mf(const std::string& path, std::string part) : path_(path), part_(std::move(part)) {}
  void prefix(std::string_view prefix, std::string_view space) override {
    spaces_[std::string(prefix)] = space;
  }
  void begin(const XmlElement& element) final;
  void end() final;

 protected:
  /// `depth`: how many elements this one lies in.
  virtual void element_begins(const XmlElement& element, std::size_t depth) = 0;
  virtual void element_ends(std::size_t depth) { (void)depth; }

  [[noreturn]] void fail(const std::string& message) const;
  /// Whether the element has this attribute; its value without blanks around it.
  static bool has(const XmlElement& element, std::string_view space, std::string_view name,
                  std::string_view& value);
  /// The value of an attribute that must be there.
  std::string_view text(const XmlElement& element, std::string_view name) const;
  double number(const XmlElement& element, std::string_view name) const;
  double positive(const XmlElement& element, std::string_view name) const;
  /// A whole number from `least` to 2^31 - 1.
  std::uint32_t whole(const XmlElement& element, std::string_view name, std::uint32_t least) const;
  /// The same of a text; `what` names it in errors.
  std::uint32_t whole(std::string_view text, std::string_view what, std::uint32_t least) const;
  double number(std::string_view text, std::string_view what) const;

  const std::string& path_;
  const std::string part_;
  std::map<std::string, std::string, std::less<>> spaces_;  ///< by prefix, as declared last

 private:
  std::size_t depth_ = 0;
};

}  // namespace slicecorr::detail
