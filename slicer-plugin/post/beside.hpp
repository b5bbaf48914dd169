// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What this program writes beside a file that it corrects: reports, FILE.html and FILE.json, and
/// texts, FILE.txt.
#pragma once

#include <string>
#include <vector>

namespace slicecorr::post {

/// What FILE.txt begins with.
inline constexpr const char* kTextFirstWords = "slicecorr-post: ";

/// Takes away what an earlier run wrote beside the file `name`, but for `written`: it tells of another
/// file than the one that is there now. Files of others stay: pages that do not say that we made them,
/// figures that are none of a prediction, texts that begin otherwise. Gives what went. Throws
/// `DeviceError` where one can't be taken away.
std::vector<std::string> remove_beside(const std::string& name,
                                       const std::vector<std::string>& written);

}  // namespace slicecorr::post
