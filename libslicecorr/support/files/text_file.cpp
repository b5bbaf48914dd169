// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "support/files/text_file.hpp"

#include <cerrno>
#include <filesystem>
#include <fstream>

#include "slicecorr/error.hpp"
#include "support/files/errno_message.hpp"
#include "support/text/display_text.hpp"

namespace slicecorr {

std::string read_text_file(const std::string& path, std::size_t most_bytes) {
  std::error_code ec;
  if (!std::filesystem::is_regular_file(path, ec)) {
    throw InputError(path, "", "is not a file that can be read");
  }
  std::ifstream in(path, std::ios::binary);
  if (!in) {
    const int why = errno;
    const std::string message = detail::errno_message(path, "can't be read", why);
    // No word about the file: who took it for none would go on as if nothing stood in it.
    if (why == EMFILE || why == ENFILE) throw DeviceError(message);
    throw InputError(message);
  }
  std::string text;
  // In pieces: what a file's size says may change meanwhile.
  constexpr std::size_t kPiece = 1 << 16;
  for (std::size_t done = 0; in;) {
    text.resize(done + kPiece);
    in.read(text.data() + done, static_cast<std::streamsize>(kPiece));
    done += static_cast<std::size_t>(in.gcount());
    text.resize(done);
    if (done > most_bytes) {
      throw InputError(path, "", "has more than " + text::bytes(static_cast<double>(most_bytes)));
    }
  }
  if (!in.eof()) throw InputError(path, "", "can't be read");
  return text;
}

std::optional<std::string> text_of_file(const std::string& path, std::size_t most_bytes) {
  try {
    return read_text_file(path, most_bytes);
  } catch (const InputError&) {
    return std::nullopt;
  }
}

}  // namespace slicecorr
