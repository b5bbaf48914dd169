// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What must be known of a 3MF before lib3mf may open it: it unpacks whatever an archive promises,
// takes coordinates that are no numbers for 0, and walks every path through the components.
#include <zip.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>

#include "mesh/mesh_parts.hpp"
#include "mesh/unpacked.hpp"
#include "support/files/unpacked_limit.hpp"

namespace slicecorr::detail {
namespace {

constexpr std::uint64_t kMostObjects = 1'000'000;  // objects of the build, repeated ones counted
constexpr int kMostLevels = 64;

/// The value of an attribute, whatever its prefix; without data when the tag has none.
std::string_view attribute(std::string_view tag, std::string_view name) {
  for (std::size_t at = tag.find(name); at != tag.npos; at = tag.find(name, at + 1)) {
    const char before = at == 0 ? '<' : tag[at - 1];
    if (before != ' ' && before != '\t' && before != '\n' && before != '\r' && before != ':') {
      continue;
    }
    const std::size_t open = tag.find_first_not_of(" \t\r\n=", at + name.size());
    if (open == tag.npos || open == at + name.size()) continue;
    if (tag[open] != '"' && tag[open] != '\'') continue;
    const std::size_t close = tag.find(tag[open], open + 1);
    if (close == tag.npos) return {};
    return tag.substr(open + 1, close - open - 1);
  }
  return {};
}

/// How often an object multiplies what it is made of, and how deep.
struct Weight {
  std::uint64_t objects = 1;
  int levels = 0;
};

class ModelCheck {
 public:
  explicit ModelCheck(const std::string& path) : path_(path) {}

  void check(const std::string& entry, std::string_view model) {
    std::size_t vertex = 0;
    Weight* object = nullptr;
    for (std::size_t at = model.find('<'); at != model.npos; at = model.find('<', at)) {
      const std::size_t end = std::min(model.find('>', at), model.size());
      const std::string_view tag = model.substr(at + 1, end - at - 1);
      at = end;
      std::string_view name = tag.substr(0, tag.find_first_of(" \t\r\n/"));
      if (const std::size_t colon = name.find(':'); colon != name.npos) {
        name.remove_prefix(colon + 1);
      }
      if (name == "vertex") {
        ++vertex;
        for (const std::string_view axis : {"x", "y", "z"}) check_number(tag, axis, entry, vertex);
      } else if (name == "object") {
        vertex = 0;
        object = &weights_[entry + '#' + std::string(attribute(tag, "id"))];
        *object = Weight();
      } else if (name == "component" && object) {
        add_component(*object, tag, entry);
      } else if (name == "item") {
        add_component(build_, tag, entry);
      }
    }
  }

 private:
  void check_number(std::string_view tag, std::string_view axis, const std::string& entry,
                    std::size_t vertex) const {
    const std::string_view text = attribute(tag, axis);
    if (text.data() == nullptr) return;  // lib3mf refuses it, unless it is of another kind
    WordReader words(text, path_);
    try {
      words.number(words.word(), "a coordinate");
      if (words.at_end()) return;
    } catch (const InputError&) {
      // Told below, by the place in the model.
    }
    throw InputError(path_, entry + ", vertex " + std::to_string(vertex),
                     "a finite number expected for " + std::string(axis) + ", found '" +
                         std::string(text.substr(0, 40)) + "'");
  }

  void add_component(Weight& object, std::string_view tag, const std::string& entry) {
    std::string_view file = attribute(tag, "path");
    if (file.starts_with('/')) file.remove_prefix(1);
    const std::string key = (file.empty() ? entry : std::string(file)) + '#';
    // Components must name what comes before them; lib3mf refuses others.
    const auto found = weights_.find(key + std::string(attribute(tag, "objectid")));
    const Weight child = found == weights_.end() ? Weight() : found->second;
    object.objects += child.objects;
    object.levels = std::max(object.levels, child.levels + 1);
    if (object.objects > kMostObjects || object.levels > kMostLevels) {
      throw InputError(path_, entry, "components repeat each other without a sensible end");
    }
  }

  const std::string& path_;
  std::map<std::string, Weight> weights_;  // by entry and object id
  Weight build_;
};

std::string unpack(zip_t* archive, const zip_stat_t& stat, const std::string& path) {
  const std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> file(
      zip_fopen_index(archive, stat.index, 0), zip_fclose);
  if (!file) throw InputError(path, stat.name, "can't be unpacked, it may be encrypted");
  std::string bytes(stat.size, '\0');
  std::size_t size = 0;
  while (size < bytes.size()) {
    const zip_int64_t got = zip_fread(file.get(), bytes.data() + size, bytes.size() - size);
    if (got <= 0) throw InputError(path, stat.name, "is damaged, it can't be unpacked");
    size += static_cast<std::size_t>(got);
  }
  // Only reading on to the end checks the sum.
  char more = 0;
  if (zip_fread(file.get(), &more, 1) != 0) throw InputError(path, stat.name, "is damaged");
  return bytes;
}

}  // namespace

void check_3mf(std::string_view bytes, const std::string& path) {
  zip_error_t error;
  zip_error_init(&error);
  const auto fail = [&](const char* what) {
    const std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    throw InputError(path, "", std::string(what) + ": " + reason);
  };
  zip_source_t* source = zip_source_buffer_create(bytes.data(), bytes.size(), 0, &error);
  if (!source) fail("can't be read");
  zip_t* opened = zip_open_from_source(source, ZIP_RDONLY, &error);
  if (!opened) {
    zip_source_free(source);
    fail("is not a 3MF (zip) file, or a damaged one");
  }
  zip_error_fini(&error);
  const std::unique_ptr<zip_t, void (*)(zip_t*)> archive(opened, zip_discard);

  std::error_code ec;
  const std::uint64_t packed = std::filesystem::file_size(path, ec);
  const std::uint64_t most = most_unpacked_bytes(ec ? 0 : packed, kLargestRatio);
  std::vector<zip_stat_t> models;
  std::uint64_t total = 0;
  const zip_int64_t entries = zip_get_num_entries(archive.get(), 0);
  for (zip_int64_t i = 0; i < entries; ++i) {
    zip_stat_t stat;
    zip_stat_init(&stat);
    constexpr zip_uint64_t needed = ZIP_STAT_NAME | ZIP_STAT_INDEX | ZIP_STAT_SIZE;
    if (zip_stat_index(archive.get(), static_cast<zip_uint64_t>(i), 0, &stat) != 0 ||
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
    if (std::string_view(stat.name).ends_with(".model")) models.push_back(stat);
  }
  // The root model may take components from the others, so it comes last.
  std::stable_partition(models.begin(), models.end(), [](const zip_stat_t& stat) {
    return std::string_view(stat.name) != "3D/3dmodel.model";
  });
  ModelCheck check(path);
  for (const zip_stat_t& stat : models) check.check(stat.name, unpack(archive.get(), stat, path));
}

}  // namespace slicecorr::detail
