// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "mesh/package_3mf.hpp"

#include <zip.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>

#include "mesh/mesh_parts.hpp"
#include "mesh/spaces_3mf.hpp"
#include "mesh/unpacked.hpp"
#include "slicecorr/error.hpp"
#include "support/files/unpacked_limit.hpp"
#include "support/text/ascii.hpp"

namespace slicecorr::detail {
namespace {

/// Parts and relations are few.
constexpr std::size_t kMost3mfParts = 100'000;

std::string shown(std::string_view text) { return std::string(text.substr(0, 80)); }

/// "%20" and the like as they are meant.
std::string unescaped(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    unsigned value = 0;
    if (text[i] == '%' && i + 2 < text.size()) {
      const char* const digits = text.data() + i + 1;
      const auto [end, error] = std::from_chars(digits, digits + 2, value, 16);
      if (error == std::errc() && end == digits + 2 && value != 0) {
        out.push_back(static_cast<char>(value));
        i += 2;
        continue;
      }
    }
    out.push_back(text[i]);
  }
  return out;
}

class RelationReader final : public Xml3mf {
 public:
  struct Found {
    std::string type, target;
    bool external = false;
    std::size_t line = 0;
  };
  using Xml3mf::Xml3mf;
  std::vector<Found> found;

 private:
  void element_begins(const XmlElement& element, std::size_t depth) override {
    if (element.space != spaces_3mf::kRelations ||
        (depth == 0) != (element.name == "Relationships")) {
      fail("the element '" + shown(element.name) + "' is none of relationships");
    }
    if (depth == 0) return;
    if (element.name != "Relationship") fail("unknown element '" + shown(element.name) + "'");
    if (found.size() == kMost3mfParts) fail("more relationships than a package needs");
    std::string_view mode;
    has(element, {}, "TargetMode", mode);
    found.push_back({std::string(text(element, "Type")), std::string(text(element, "Target")),
                     mode == "External", line()});
  }
};

}  // namespace

void Xml3mf::begin(const XmlElement& element) {
  if (depth_ == kMost3mfDepth) {
    fail("elements are more than " + std::to_string(kMost3mfDepth) + " deep in each other");
  }
  for (const XmlAttribute& attribute : element.attributes) {
    if (attribute.space == spaces_3mf::kXmlSpace && attribute.name == "space") {
      fail("the element '" + shown(element.name) + "' has xml:space, which 3MF does not allow");
    }
  }
  element_begins(element, depth_++);
}

void Xml3mf::end() { element_ends(--depth_); }

void Xml3mf::fail(const std::string& message) const {
  throw InputError(path_, part_ + ", line " + std::to_string(line ? line() : 0), message);
}

bool Xml3mf::has(const XmlElement& element, std::string_view space, std::string_view name,
                 std::string_view& value) {
  for (const XmlAttribute& attribute : element.attributes) {
    if (attribute.name != name || attribute.space != space) continue;
    value = trimmed(attribute.value);
    return true;
  }
  return false;
}

std::string_view Xml3mf::text(const XmlElement& element, std::string_view name) const {
  std::string_view value;
  if (has(element, {}, name, value)) return value;
  fail("the element '" + shown(element.name) + "' lacks the attribute '" + std::string(name) + "'");
}

double Xml3mf::number(std::string_view text, std::string_view what) const {
  std::string_view digits = text;
  if (digits.size() > 1 && digits[0] == '+' && digits[1] != '-') digits.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  const bool whole = !digits.empty() && end == digits.data() + digits.size();
  if (whole && error == std::errc::result_out_of_range &&
      digits.find_first_of("eE") != digits.npos &&
      digits.find('-', digits.find_first_of("eE")) != digits.npos) {
    return 0;  // too small for a double
  }
  if (!whole || error != std::errc() || !std::isfinite(value)) {
    fail("a finite number expected for " + std::string(what) + ", found '" + shown(text) + "'");
  }
  return value;
}

double Xml3mf::number(const XmlElement& element, std::string_view name) const {
  return number(text(element, name), name);
}

double Xml3mf::positive(const XmlElement& element, std::string_view name) const {
  const double value = number(element, name);
  if (value > 0) return value;
  fail("a number above 0 expected for " + std::string(name) + ", found '" +
       shown(text(element, name)) + "'");
}

std::uint32_t Xml3mf::whole(std::string_view text, std::string_view what,
                            std::uint32_t least) const {
  std::string_view digits = text;
  if (digits.size() > 1 && digits[0] == '+') digits.remove_prefix(1);
  std::uint32_t value = 0;
  const auto [end, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || end != digits.data() + digits.size() || value < least ||
      value > 0x7fffffff) {
    fail("a whole number from " + std::to_string(least) + " expected for " + std::string(what) +
         ", found '" + shown(text) + "'");
  }
  return value;
}

std::uint32_t Xml3mf::whole(const XmlElement& element, std::string_view name,
                            std::uint32_t least) const {
  return whole(text(element, name), name, least);
}

Package3mf::Package3mf(std::string_view bytes, const std::string& path) : path_(path) {
  zip_error_t error;
  zip_error_init(&error);
  const auto fail = [&](const char* what) {
    const std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    throw InputError(path, "", std::string(what) + ": " + reason);
  };
  zip_source_t* source = zip_source_buffer_create(bytes.data(), bytes.size(), 0, &error);
  if (!source) fail("can't be read");
  zip_ = zip_open_from_source(source, ZIP_RDONLY, &error);
  if (!zip_) {
    zip_source_free(source);
    fail("is not a 3MF (zip) file, or a damaged one");
  }
  zip_error_fini(&error);
  try {
    std::error_code ec;
    const std::uint64_t packed = std::filesystem::file_size(path, ec);
    const std::uint64_t most = most_unpacked_bytes(ec ? 0 : packed, kLargestRatio);
    std::uint64_t total = 0;
    const zip_int64_t entries = zip_get_num_entries(zip_, 0);
    if (entries > static_cast<zip_int64_t>(kMost3mfParts)) {
      throw InputError(path, "", "has more parts than a 3MF needs");
    }
    for (zip_int64_t i = 0; i < entries; ++i) {
      zip_stat_t stat;
      zip_stat_init(&stat);
      constexpr zip_uint64_t needed = ZIP_STAT_NAME | ZIP_STAT_INDEX | ZIP_STAT_SIZE;
      if (zip_stat_index(zip_, static_cast<zip_uint64_t>(i), 0, &stat) != 0 ||
          (stat.valid & needed) != needed) {
        throw InputError(path, "entry " + std::to_string(i + 1), "the zip directory is damaged");
      }
      if (stat.size > kMostUnpackedBytes || (total += stat.size) > kMostUnpackedBytes) {
        throw InputError(path, "", "would unpack to more than 2 GiB");
      }
      if (total > most) {
        throw InputError(path, "",
                         "would unpack to more than " + std::to_string(most) + " bytes, " +
                             std::to_string(kLargestRatio) + " times its size; expected a mesh");
      }
      std::string name = stat.name;
      std::replace(name.begin(), name.end(), '\\', '/');  // as some programs write them
      if (name.starts_with('/')) name.erase(0, 1);
      if (name.empty() || name.ends_with('/')) continue;
      const bool first = parts_.emplace(lower_case(name), Part{name, stat.index, stat.size}).second;
      if (!first) throw InputError(path, shown(name), "this part is there twice");
    }
  } catch (...) {
    zip_discard(zip_);
    throw;
  }
}

Package3mf::~Package3mf() { zip_discard(zip_); }

const Package3mf::Part* Package3mf::find(std::string_view part) const {
  const auto found = parts_.find(lower_case(part));
  return found == parts_.end() ? nullptr : &found->second;
}

std::string Package3mf::resolve(std::string_view target, const std::string& part) const {
  std::vector<std::string> folders;
  const auto walk = [&](std::string_view way) {
    while (!way.empty()) {
      const std::size_t slash = std::min(way.find('/'), way.size());
      const std::string step = unescaped(way.substr(0, slash));
      way.remove_prefix(std::min(slash + 1, way.size()));
      if (step.empty() || step == ".") continue;
      if (step != "..") {
        folders.push_back(step);
        continue;
      }
      if (folders.empty()) {
        throw InputError(path_, part, "'" + shown(target) + "' leads out of the package");
      }
      folders.pop_back();
    }
  };
  if (!target.starts_with('/')) {
    walk(std::string_view(part).substr(0, part.rfind('/') == part.npos ? 0 : part.rfind('/')));
  }
  walk(target);
  std::string name;
  for (const std::string& folder : folders) name += (name.empty() ? "" : "/") + folder;
  const Part* const found = find(name);
  if (found) return found->name;
  throw InputError(path_, part, "points to '" + shown(target) + "', which is not in the package");
}

std::vector<Package3mf::Relation> Package3mf::relations(const std::string& part) const {
  const std::size_t slash = part.rfind('/');
  const std::string folder = slash == part.npos ? "" : part.substr(0, slash + 1);
  const Part* const own =
      find(folder + "_rels/" + (slash == part.npos ? part : part.substr(slash + 1)) + ".rels");
  std::vector<Relation> all;
  if (!own) return all;
  RelationReader reader(path_, own->name);
  read_xml(own->name, reader);
  int tickets = 0;
  for (const RelationReader::Found& found : reader.found) {
    // Links to the world outside concern people who look at the file.
    if (found.external && found.type != spaces_3mf::kModelType) continue;
    const std::string at = own->name + ", line " + std::to_string(found.line);
    if (found.external) throw InputError(path_, at, "the model is not in the package");
    if (found.type == spaces_3mf::kTicketType && ++tickets > 1) {
      throw InputError(path_, at, "there is more than one print ticket");
    }
    all.push_back({found.type, resolve(found.target, part)});
  }
  return all;
}

std::string Package3mf::model_part() const {
  std::optional<std::string> model;
  for (const Relation& relation : relations("")) {
    if (relation.type != spaces_3mf::kModelType) continue;
    if (model) throw InputError(path_, "_rels/.rels", "there is more than one model to print");
    model = relation.target;
  }
  if (model) return *model;
  throw InputError(path_, "_rels/.rels", "says no model to print (3dmodel)");
}

std::vector<std::string> Package3mf::parts(std::string_view begin, std::string_view end) const {
  std::vector<std::string> found;
  for (const auto& [key, part] : parts_) {
    if (key.starts_with(lower_case(begin)) && key.ends_with(lower_case(end))) {
      found.push_back(part.name);
    }
  }
  return found;
}

void Package3mf::read_xml(const std::string& part, XmlSink& sink) const {
  const Part* const own = find(part);
  if (!own) throw InputError(path_, part, "is not in the package");
  const std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> file(zip_fopen_index(zip_, own->index, 0),
                                                               zip_fclose);
  if (!file) throw InputError(path_, own->name, "can't be unpacked, it may be encrypted");
  std::vector<char> piece(std::size_t{1} << 18);
  std::uint64_t done = 0;
  // Only reading on to the end checks the sum.
  const auto next = [&]() -> std::string_view {
    const zip_int64_t got = zip_fread(file.get(), piece.data(), piece.size());
    if (got < 0 || (got == 0 && done != own->bytes)) {
      throw InputError(path_, own->name, "is damaged, it can't be unpacked");
    }
    done += static_cast<std::uint64_t>(got);
    if (done > own->bytes) throw InputError(path_, own->name, "is damaged: longer than it says");
    return {piece.data(), static_cast<std::size_t>(got)};
  };
  XmlFault fault;
  if (mesh_functions().parse_xml(next, sink, fault)) return;
  throw InputError(path_, own->name + ", line " + std::to_string(fault.line),
                   "is no XML that 3MF allows: " + fault.words);
}

}  // namespace slicecorr::detail
