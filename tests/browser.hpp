/// @file browser.hpp
/// Pages in a real browser, without a window.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <string>
#include <vector>

#include "run_program.hpp"

namespace slicecorr::test {

/// Path of Chromium; empty when it is not installed.
inline std::string chromium() {
  // First what the script in /usr/bin starts: it looks at the computer for a tenth of a second.
  for (const char* path :
       {"/usr/lib/chromium/chromium", "/usr/bin/chromium", "/usr/bin/chromium-browser"}) {
    if (std::filesystem::exists(path)) return path;
  }
  return {};
}

/// A folder that goes with the test.
struct BrowserFolder {
  BrowserFolder()
      : path(std::filesystem::path(::testing::TempDir()) /
             ("browser-" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(path);
  }
  ~BrowserFolder() {
    std::error_code error;
    std::filesystem::remove_all(path, error);
  }
  BrowserFolder(const BrowserFolder&) = delete;
  BrowserFolder& operator=(const BrowserFolder&) = delete;
  std::filesystem::path path;
};

/// Opens an address; `flags` say what comes of it: --dump-dom, --screenshot=FILE,
/// --print-to-pdf=FILE.
inline RunResult browse(const BrowserFolder& folder, const std::vector<std::string>& flags,
                        const std::string& address) {
  std::vector<std::string> command{chromium(),
                                   "--headless",
                                   "--no-sandbox",
                                   "--disable-gpu",
                                   "--disable-quic",
                                   "--no-first-run",
                                   "--disable-background-networking",
                                   "--disable-component-update",
                                   "--disable-sync",
                                   "--hide-scrollbars",
                                   "--virtual-time-budget=30000",
                                   "--user-data-dir=" + (folder.path / "profile").string()};
  command.insert(command.end(), flags.begin(), flags.end());
  command.push_back(address);
  RunOptions options;
  options.timeout = std::chrono::seconds(120);
  return run_program(command, options);
}

}  // namespace slicecorr::test
