// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What became of a file, as a text beside it: FILE.txt.
#pragma once

#include <string>

namespace slicecorr::post {

/// Writes `part.sl1.txt`, in the place of an earlier one of ours. Gives what went wrong; empty: it is
/// written. A text that others wrote stays, and that is told. `message`: sentences, each on a line.
std::string write_text_beside(const std::string& path, const std::string& title,
                              const std::string& message);

}  // namespace slicecorr::post
