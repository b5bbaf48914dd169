// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file temporary.hpp
/// Files and folders that are made under another name beside their place, and renamed when whole.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "support/files/maker.hpp"

namespace slicecorr::detail {

/// A path taken apart: "a/b.zip" lies in "a", "b.zip" in ".".
struct PathParts {
  std::string folder, file;
};
PathParts path_parts(const std::string& path);

/// A name beside `path` that nothing else has: ".FILE.MAKER-N.part" (maker.hpp). `make_folder`: an empty folder of that
/// name is made, else an empty file. What processes that are no more left in the folder is removed before
/// (`remove_left_over`). Throws `DeviceError`.
std::string make_temporary(const std::string& path, bool make_folder = false);

/// Throws `DeviceError` when no file can be made, or none replaced, at `path`.
void check_new_file(const std::string& path);
/// Throws `DeviceError` when the file at `path` may not be written, or not be replaced because
/// others own it and the folder keeps names for owners (as /tmp does). Without a file: nothing.
void check_may_replace(const std::string& path);

/// A name that `make_temporary` gives, or that the zip library makes of it, or that of a work folder.
struct TemporaryName {
  Maker maker;
  std::string file;  ///< that it was to become, its first bytes; empty for a work folder
};
std::optional<TemporaryName> temporary_name(const std::string& file);

/// Work folders hold what a correction in place makes on the way: ".slicecorr-post-MAKER-XXXXXX", where the last six
/// are any. In one, the file `kInWork` names what is corrected.
inline constexpr std::string_view kWorkFolder = ".slicecorr-post-";
inline constexpr std::string_view kInWork = "in-work";

/// Removes what processes that are no more (killed, or the power failed) left in a folder under temporary names,
/// whatever it was to become; never what a living one, another user, computer or container has made. Of a work folder
/// that says what was in work that stays for a day, for who watches the folder has to take it up again; unless
/// `known`, which is called with its path, says that it may go. Nothing throws: what can't be removed stays.
void remove_left_over(const std::string& folder,
                      const std::function<bool(const std::string& path)>& known = {});

/// Waits until the contents of a file, or the names in a folder, are on the disk: a rename must not
/// come before them. Throws `DeviceError`.
void sync_file(const std::string& path);
void sync_folder(const std::string& path);

/// Removes a temporary file at the end of its scope unless it was renamed.
struct Temporary {
  std::string path;
  bool keep = false;
  ~Temporary();
};

/// Gives a temporary file its name: what was written is on the disk before, and the name after, so that a power cut
/// leaves the old file or the new one, whole. Throws `DeviceError`.
void put_in_place(Temporary& temporary, const std::string& path);

/// Gives `to` the mode, and where allowed the owner, of `from`.
void copy_mode(const std::string& from, const std::string& to);

/// A second name for a file's contents: a link where the file system can, else a copy. Throws
/// `DeviceError`; `InputError` when `from` is no more.
void link_or_copy(const std::string& from, const std::string& to);

}  // namespace slicecorr::detail
