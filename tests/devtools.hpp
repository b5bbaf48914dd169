// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// @file devtools.hpp
/// Chromium driven by its DevTools protocol over two pipes: pages are clicked, typed into and looked
/// at as somebody would.
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "rounds.hpp"
#include "run_program.hpp"
#include "support/text/base64.hpp"

namespace slicecorr::test {

/// Path of Chromium; empty when it is not installed.
inline std::string chromium() {
  // The one without windows starts with half the work, and what the script in /usr/bin starts
  // without looking at the computer for a tenth of a second.
  for (const char* path :
       {"/usr/lib/chromium/chromium-headless-shell", "/usr/lib/chromium/chromium",
        "/usr/bin/chromium", "/usr/bin/chromium-browser"}) {
    if (std::filesystem::exists(path)) return path;
  }
  return {};
}

/// A folder that goes with its owner: a test's pages.
struct BrowserFolder {
  explicit BrowserFolder(const std::string& name = "pages")
      : path(std::filesystem::path(::testing::TempDir()) /
             (name + "-" + std::to_string(::getpid()))) {
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

/// The browser of an executable: starting one takes as long as most tests. Throws
/// `std::runtime_error` where it does not answer.
class BrowserProcess {
 public:
  using Json = nlohmann::json;

  /// Started when it is first asked for, and when the last one is gone.
  static BrowserProcess& shared() {
    static std::unique_ptr<BrowserProcess> browser;
    if (!browser || browser->gone_) browser = std::make_unique<BrowserProcess>();
    return *browser;
  }

  BrowserProcess() {
    int in[2], out[2];
    if (::pipe2(in, O_CLOEXEC) != 0 || ::pipe2(out, O_CLOEXEC) != 0) {
      throw std::runtime_error("no pipes");
    }
    const std::string program = chromium();
    const std::string profile = "--user-data-dir=" + (folder_.path / "profile").string();
    std::vector<const char*> argv{program.c_str(), "--headless", "--no-sandbox", "--disable-gpu",
                                  "--disable-quic", "--no-first-run", "--hide-scrollbars",
                                  "--disable-background-networking", "--disable-component-update",
                                  "--disable-sync",
                                  // Names of others that lead here, as their owners can have it.
                                  "--host-resolver-rules=MAP *.example 127.0.0.1",
                                  "--remote-debugging-pipe", profile.c_str(), nullptr};
    pid_ = ::vfork();
    if (pid_ == 0) {
      ::setpgid(0, 0);
      const int quiet = ::open("/dev/null", O_RDWR);
      ::dup2(quiet, STDIN_FILENO);
      ::dup2(quiet, STDOUT_FILENO);
      ::dup2(quiet, STDERR_FILENO);
      // The protocol's places are 3 and 4; the pipes may lie there crosswise.
      const int from = ::fcntl(in[0], F_DUPFD, 100), to = ::fcntl(out[1], F_DUPFD, 100);
      ::dup2(from, 3);
      ::dup2(to, 4);
      ::execv(argv[0], const_cast<char* const*>(argv.data()));
      ::_exit(127);
    }
    ::close(in[0]);
    ::close(out[1]);
    to_ = in[1];
    from_ = out[0];
  }
  ~BrowserProcess() {
    ::kill(-pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    ::close(to_);
    ::close(from_);
  }
  BrowserProcess(const BrowserProcess&) = delete;
  BrowserProcess& operator=(const BrowserProcess&) = delete;

  /// `session`: whom to ask; empty: the browser.
  Json call(const std::string& session, const std::string& method, Json params) {
    const int id = ++calls_;
    Json message{{"id", id}, {"method", method}, {"params", std::move(params)}};
    if (!session.empty()) message["sessionId"] = session;
    std::string text = message.dump();
    text.push_back('\0');
    for (std::size_t at = 0; at < text.size();) {
      const ssize_t n = ::write(to_, text.data() + at, text.size() - at);
      if (n <= 0) lose("the browser is gone");
      at += static_cast<std::size_t>(n);
    }
    for (;;) {
      const Json answer = next();
      if (answer.value("id", 0) != id) continue;
      if (answer.contains("error"))
        throw std::runtime_error(method + ": " + answer["error"].dump());
      return answer["result"];
    }
  }
  /// Errors of the scripts of a session, and what the policy blocked.
  const std::vector<std::string>& complaints(const std::string& session) {
    return complaints_[session];
  }

 private:
  Json next() {
    for (;;) {
      const std::size_t end = buffer_.find('\0');
      if (end != std::string::npos) {
        Json message = Json::parse(buffer_.substr(0, end));
        buffer_.erase(0, end + 1);
        const std::string method = message.value("method", "");
        if (method == "Runtime.exceptionThrown" ||
            (method == "Log.entryAdded" && message["params"]["entry"]["level"] == "error" &&
             message["params"]["entry"]["source"] != "network")) {
          complaints_[message.value("sessionId", "")].push_back(message["params"].dump());
        }
        return message;
      }
      pollfd fd{from_, POLLIN, 0};
      if (::poll(&fd, 1, 90'000) <= 0) lose("the browser does not answer");
      char bytes[65536];
      const ssize_t n = ::read(from_, bytes, sizeof bytes);
      if (n <= 0) lose("the browser is gone");
      buffer_.append(bytes, static_cast<std::size_t>(n));
    }
  }
  [[noreturn]] void lose(const char* why) {
    gone_ = true;
    throw std::runtime_error(why);
  }

  const BrowserFolder folder_{"browser"};
  pid_t pid_ = -1;
  int to_ = -1, from_ = -1, calls_ = 0;
  bool gone_ = false;
  std::string buffer_;
  std::map<std::string, std::vector<std::string>> complaints_;
};

/// One page, which shares neither cookies nor storage with those before it.
class DrivenPage {
 public:
  using Json = nlohmann::json;

  DrivenPage() : browser_(BrowserProcess::shared()) {
    context_ = call("Target.createBrowserContext")["browserContextId"];
    const Json target =
        call("Target.createTarget", {{"url", "about:blank"}, {"browserContextId", context_}});
    session_ = call("Target.attachToTarget",
                    {{"targetId", target["targetId"]}, {"flatten", true}})["sessionId"];
    call("Page.enable");
    call("Runtime.enable");
    call("Log.enable");
    call("DOM.enable");
  }
  ~DrivenPage() {
    try {
      session_.clear();
      call("Target.disposeBrowserContext", {{"browserContextId", context_}});
    } catch (const std::exception&) {  // the test has said so, or the next one gets another browser
    }
  }
  DrivenPage(const DrivenPage&) = delete;
  DrivenPage& operator=(const DrivenPage&) = delete;

  /// How large the window is, and whether the person likes it dark.
  void look_like(int width, int height, bool dark) {
    width_ = width;
    call("Emulation.setDeviceMetricsOverride",
         {{"width", width}, {"height", height}, {"deviceScaleFactor", 1}, {"mobile", false}});
    call("Emulation.setEmulatedMedia",
         {{"features",
           Json::array({{{"name", "prefers-color-scheme"}, {"value", dark ? "dark" : "light"}}})}});
  }
  void open(const std::string& address) {
    call("Page.navigate", {{"url", address}});
    wait_for("document.readyState === 'complete'");
  }
  /// What an expression gives; promises are waited for.
  Json eval(const std::string& expression) {
    const Json r =
        call("Runtime.evaluate",
             {{"expression", expression}, {"awaitPromise", true}, {"returnByValue", true}});
    if (r.contains("exceptionDetails")) {
      throw std::runtime_error(expression + ": " + r["exceptionDetails"].dump());
    }
    return r["result"].value("value", Json());
  }
  /// Waits until an expression holds; longer for what instrumented programs compute.
  void wait_for(const std::string& expression, double seconds = 60) {
    const auto until =
        std::chrono::steady_clock::now() + std::chrono::duration<double>(kSlowdown * seconds);
    while (std::chrono::steady_clock::now() < until) {
      try {
        if (eval("Boolean(" + expression + ")") == true) return;
      } catch (const std::runtime_error&) {  // between two pages
      }
      ::usleep(50'000);
    }
    throw std::runtime_error("did not come: " + expression + "; the page says: " +
                             eval("document.body.innerText").dump().substr(0, 3000));
  }
  std::string text(const std::string& id) {
    return eval("document.getElementById('" + id + "').innerText").get<std::string>();
  }
  void click(const std::string& selector) {
    eval("(() => { const e = document.querySelector(" + Json(selector).dump() +
         "); if (!e || e.disabled) throw new Error('can not be clicked'); e.click(); })()");
  }
  /// Puts a value in, as typing it does.
  void set(const std::string& id, const std::string& value) {
    eval("(() => { const e = document.getElementById('" + id +
         "'); e.value = " + Json(value).dump() +
         "; for (const n of ['input', 'change']) e.dispatchEvent(new Event(n, {bubbles: true})); "
         "})()");
  }
  void choose_files(const std::string& selector, const std::vector<std::string>& paths) {
    const Json root = call("DOM.getDocument");
    const Json node =
        call("DOM.querySelector", {{"nodeId", root["root"]["nodeId"]}, {"selector", selector}});
    call("DOM.setFileInputFiles", {{"nodeId", node["nodeId"]}, {"files", paths}});
  }
  /// Asks the protocol itself.
  Json ask(const std::string& method, Json params = Json::object()) {
    return call(method, std::move(params));
  }
  /// One key, down and up: "Tab", "Enter", "ArrowLeft", "+".
  void key(const std::string& name) {
    static const std::map<std::string, int> codes{
        {"Tab", 9},         {"Enter", 13},     {"ArrowLeft", 37}, {"ArrowUp", 38},
        {"ArrowRight", 39}, {"ArrowDown", 40}, {"PageUp", 33},    {" ", 32}};
    const auto code = codes.find(name);
    Json down{{"type", "keyDown"}, {"key", name}};
    if (code != codes.end()) down["windowsVirtualKeyCode"] = code->second;
    if (name == "Enter") down["text"] = "\r";
    if (name.size() == 1) down["text"] = name;
    call("Input.dispatchKeyEvent", down);
    down["type"] = "keyUp";
    down.erase("text");
    call("Input.dispatchKeyEvent", down);
  }
  /// What the page's own test (#selftest) says, in a window of such a width.
  Json selftest(const std::string& address, int width) {
    look_like(width, 900, false);
    open("about:blank");  // or the same address would only go to its end
    open(address + "#selftest");
    wait_for("document.getElementById('selftest')", 120);
    return Json::parse(eval("document.getElementById('selftest').textContent").get<std::string>(),
                       nullptr, false);
  }
  /// The page as it is on a desk, light and dark, and on a phone: FOLDER/NAME-light.png, -dark.png,
  /// -phone.png; by day light on a desk and dark on a phone, NAME-dark-phone.png. `ready`: an
  /// expression that holds once all is drawn.
  void looks(const std::string& address, const std::filesystem::path& folder,
             const std::string& name, const std::string& ready) {
    std::vector<std::tuple<std::string, int, bool>> all{{"light", 1280, false},
                                                        {"dark-phone", 400, true}};
    if (by_night()) all = {all[0], all[1], {"dark", 1280, true}, {"phone", 400, false}};
    bool opened = false;
    for (const auto& [look, width, dark] : all) {
      look_like(width, 900, dark);
      // Pictures are drawn once, for the colours and the width that they find.
      if (opened) {
        call("Page.reload");
      } else {
        open(address);
      }
      opened = true;
      wait_for("document.readyState === 'complete' && " + ready);
      const auto file = folder / (name + "-" + look + ".png");
      std::filesystem::remove(file);
      picture(file);
      ASSERT_TRUE(std::filesystem::exists(file));
      EXPECT_GT(std::filesystem::file_size(file), 30'000U) << file;
    }
  }
  /// The page on paper.
  void print(const std::filesystem::path& file) {
    const Json sheets = call("Page.printToPDF", {{"printBackground", true}});
    const auto bytes = slicecorr::detail::from_base64(sheets["data"].get<std::string>());
    ASSERT_TRUE(bytes);
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes->data()),
               static_cast<std::streamsize>(bytes->size()));
  }
  /// The whole page as a picture.
  void picture(const std::filesystem::path& file) {
    const int height = eval("document.documentElement.scrollHeight").get<int>();
    const Json shot =
        call("Page.captureScreenshot",
             {{"format", "png"},
              {"captureBeyondViewport", true},
              {"clip", {{"x", 0}, {"y", 0}, {"width", width_}, {"height", height}, {"scale", 1}}}});
    const auto bytes = slicecorr::detail::from_base64(shot["data"].get<std::string>());
    ASSERT_TRUE(bytes);
    std::filesystem::create_directories(file.parent_path());
    std::ofstream(file, std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes->data()),
               static_cast<std::streamsize>(bytes->size()));
  }
  /// The page's elements as they are now.
  std::string dom() { return eval("document.documentElement.outerHTML").get<std::string>(); }
  /// Errors of scripts, and what the policy blocked.
  const std::vector<std::string>& complaints() const { return browser_.complaints(session_); }

 private:
  Json call(const std::string& method, Json params = Json::object()) {
    return browser_.call(session_, method, std::move(params));
  }

  BrowserProcess& browser_;
  int width_ = 800;
  std::string context_, session_;
};

}  // namespace slicecorr::test
