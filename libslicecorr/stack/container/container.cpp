// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/container.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>

#include "slicecorr/error.hpp"
#include "stack/container/binary_file.hpp"
#include "stack/container/container_output.hpp"
#include "stack/container/folder_container.hpp"
#include "stack/container/tar_container.hpp"
#include "stack/container/zip_input.hpp"
#include "stack/container/zip_output.hpp"
#include "stack/formats/known_foreign.hpp"
#include "support/files/errno_message.hpp"

namespace slicecorr::detail {

std::string shown_name(std::string_view name) {
  std::string text(name.substr(0, 100));
  for (char& c : text) {
    if (static_cast<unsigned char>(c) < 32 || c == 127) c = '?';
  }
  return text;
}

const Container::Entry* Container::find(std::string_view name) const {
  const auto found =
      std::lower_bound(entries_.begin(), entries_.end(), name,
                       [](const Entry& e, std::string_view n) { return e.name < n; });
  return found != entries_.end() && found->name == name ? &*found : nullptr;
}

std::string Container::text(std::string_view name, std::uint64_t limit) const {
  const Entry* const entry = find(name);
  if (entry == nullptr) throw InputError(path_, std::string(name), "is missing");
  std::vector<std::uint8_t> bytes;
  read(*entry, limit, bytes);
  return {bytes.begin(), bytes.end()};
}

void Container::finish_list() {
  std::sort(entries_.begin(), entries_.end(),
            [](const Entry& a, const Entry& b) { return a.name < b.name; });
  const auto same = [](const Entry& a, const Entry& b) { return a.name == b.name; };
  const auto doubled = std::adjacent_find(entries_.begin(), entries_.end(), same);
  if (doubled != entries_.end()) {
    throw InputError(path_, shown_name(doubled->name), "is there more than once");
  }
}

bool is_safe_name(std::string_view name) {
  if (name.empty() || name.front() == '/' || name.find('\\') != name.npos) return false;
  if (name.find('\0') != name.npos) return false;
  if (name.size() > 1 && name[1] == ':') return false;
  for (std::size_t start = 0; start <= name.size();) {
    const std::size_t end = std::min(name.find('/', start), name.size());
    if (name.substr(start, end - start) == "..") return false;
    start = end + 1;
  }
  return true;
}

ContainerKind container_kind(const std::string& path) {
  struct stat status;
  if (::stat(path.c_str(), &status) != 0) {
    throw InputError(errno_message(path, "can't be read"));
  }
  if (S_ISDIR(status.st_mode)) return ContainerKind::folder;
  // A pipe would block, and a zip needs to be read from its end.
  if (!S_ISREG(status.st_mode)) throw InputError(path, "", "not a file, expected a slice archive");
  refuse_known_file(path);
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (file < 0) throw InputError(errno_message(path, "can't be read"));
  char start[16] = {};
  const ssize_t n = ::read(file, start, sizeof start);
  ::close(file);
  const std::string_view magic(start, n > 0 ? static_cast<std::size_t>(n) : 0);
  if (magic.starts_with("\x1f\x8b")) return ContainerKind::tar_gz;
  if (is_binary_print_file(magic)) return ContainerKind::binary;
  return ContainerKind::zip;
}

std::unique_ptr<Container> open_container(const std::string& path,
                                          const std::string& scratch_folder,
                                          const ExecutionContext& context) {
  switch (container_kind(path)) {
    case ContainerKind::tar_gz:
      return open_tar_gz(path, scratch_folder, context);
    case ContainerKind::folder:
      return open_folder(path);
    case ContainerKind::binary:
      return std::make_unique<BinaryFile>(path);
    default:
      return std::make_unique<ZipInput>(path);
  }
}

ContainerOutput::ContainerOutput(const std::string& path) : path_(path) {
  const PathParts place = path_parts(path);
  folder_ = place.folder;
  file_ = place.file;
}

void ContainerOutput::Source::make(std::vector<std::uint8_t>& contents) const {
  contents.clear();
  fill(number, contents);
  if (contents.size() != size) throw Error("an entry has not the promised size");
}

void ContainerOutput::add(std::string name, std::vector<std::uint8_t> data) {
  const std::uint64_t size = data.size();
  auto fill = [data = std::move(data)](std::size_t, std::vector<std::uint8_t>& out) { out = data; };
  sources_.push_back({std::move(name), size, std::move(fill), 0});
}

void ContainerOutput::add_text(std::string name, const std::string& text) {
  add(std::move(name), {text.begin(), text.end()});
}

void ContainerOutput::add_lazily(const std::vector<std::string>& names,
                                 const std::vector<std::uint64_t>& sizes, Fill fill) {
  // Shared by all entries: a million copies of the function would take much memory.
  const auto shared = std::make_shared<Fill>(std::move(fill));
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    sources_.push_back(
        {names[i], sizes[i],
         [shared](std::size_t n, std::vector<std::uint8_t>& out) { (*shared)(n, out); }, i});
  }
}

std::unique_ptr<ContainerOutput> make_container_output(const std::string& path, ContainerKind kind,
                                                       const std::string& keep_from,
                                                       ImagePacking images) {
  switch (kind) {
    case ContainerKind::tar_gz:
      return make_tar_gz_output(path, keep_from);
    case ContainerKind::folder:
      return make_folder_output(path, keep_from);
    case ContainerKind::binary:
      return std::make_unique<BinaryOutput>(path, keep_from);
    default:
      return std::make_unique<ZipOutput>(path, keep_from, images);
  }
}

}  // namespace slicecorr::detail
