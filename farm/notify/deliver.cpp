// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// One message to one receiver.

#include <fcntl.h>
#include <fmt/format.h>
#include <httplib.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <chrono>
#include <cstring>
#include <thread>

#include "slicecorr/farm/notify.hpp"
#include "slicecorr/version.hpp"
#include "support/http/why_no_answer.hpp"
#include "support/process/no_sigpipe.hpp"

namespace slicecorr::farm {

namespace {

using Steady = std::chrono::steady_clock;

std::string post(const NotifyTarget& target, const Notice& notice, int stop_fd) {
  const std::size_t slash = target.url.find('/', target.url.find("://") + 3);
  const std::string server = target.url.substr(0, slash);
  const std::string path = slash == std::string::npos ? "/" : target.url.substr(slash);
  const std::size_t at = server.rfind('@');
  const std::size_t host = server.find("://") + 3;
  httplib::Client client(at == std::string::npos ? server
                                                 : server.substr(0, host) + server.substr(at + 1));
  if (!client.is_valid()) return "no address";
  if (at != std::string::npos) {
    const std::string login = server.substr(host, at - host);
    const std::size_t colon = std::min(login.find(':'), login.size());
    client.set_basic_auth(login.substr(0, colon),
                          colon < login.size() ? login.substr(colon + 1).c_str() : "");
  }
  const auto timeout = std::chrono::milliseconds(static_cast<long>(target.timeout_s * 1000));
  client.set_connection_timeout(timeout);
  client.set_read_timeout(timeout);
  client.set_write_timeout(timeout);
  client.set_follow_location(false);
  if (!target.ca_file.empty()) client.set_ca_cert_path(target.ca_file);
  httplib::Headers headers{{"User-Agent", fmt::format("slicefarm/{}", version)},
                           {"Idempotency-Key", notice.id}};
  for (const std::string& h : target.headers) {
    const std::size_t colon = h.find(": ");
    headers.emplace(h.substr(0, colon), h.substr(colon + 2));
  }
  // Whoever stops must not wait for a receiver that says nothing.
  std::atomic<bool> ended{false};
  std::thread guard([&] {
    const auto until = Steady::now() + 2 * timeout;
    while (!ended && Steady::now() < until) {
      pollfd fd{stop_fd, POLLIN, 0};
      if (::poll(&fd, 1, 50) > 0) break;
    }
    if (!ended) client.stop();
  });
  const NoSigpipe no_sigpipe;
  const auto result = client.Post(path, headers, notice.json, "application/json");
  ended = true;
  guard.join();
  if (!result) return http::why_no_answer(result.error());
  if (result->status >= 200 && result->status < 300) return {};
  return fmt::format("answers {}", result->status);
}

std::string run(const NotifyTarget& target, const Notice& notice, int stop_fd) {
  std::vector<char*> argv;
  for (const std::string& a : target.command) argv.push_back(const_cast<char*>(a.c_str()));
  argv.push_back(nullptr);
  std::vector<std::string> variables;
  for (char** v = environ; *v != nullptr; ++v) {
    if (std::strncmp(*v, "FARM_", 5) != 0) variables.emplace_back(*v);
  }
  for (const auto& [name, value] : notice.variables) variables.push_back(name + "=" + value);
  std::vector<char*> envp;
  envp.reserve(variables.size() + 1);
  for (std::string& s : variables) envp.push_back(s.data());
  envp.push_back(nullptr);

  // stdin is a file in memory: a program that does not read it holds nobody up.
  const int input = ::memfd_create("notice", MFD_CLOEXEC);
  const int nothing = ::open("/dev/null", O_WRONLY | O_CLOEXEC);
  if (input < 0 || nothing < 0 ||
      ::write(input, notice.json.data(), notice.json.size()) !=
          static_cast<ssize_t>(notice.json.size()) ||
      ::lseek(input, 0, SEEK_SET) != 0) {
    if (input >= 0) ::close(input);
    if (nothing >= 0) ::close(nothing);
    return "no file for its input";
  }
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
  posix_spawn_file_actions_adddup2(&files, nothing, STDOUT_FILENO);
  posix_spawn_file_actions_adddup2(&files, nothing, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  // A group of its own: what it starts ends with it. Signals as a program expects them.
  posix_spawnattr_setpgroup(&attributes, 0);
  sigset_t none, all;
  sigemptyset(&none);
  sigfillset(&all);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setsigdefault(&attributes, &all);
  posix_spawnattr_setflags(
      &attributes,
      static_cast<short>(POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF));
  pid_t child = 0;
  const int error = ::posix_spawn(&child, argv[0], &files, &attributes, argv.data(), envp.data());
  posix_spawn_file_actions_destroy(&files);
  posix_spawnattr_destroy(&attributes);
  ::close(input);
  ::close(nothing);
  if (error != 0) return fmt::format("can't be started: {}", std::strerror(error));

  const auto until = Steady::now() + std::chrono::duration<double>(target.timeout_s);
  int status = 0;
  std::string ended;
  for (;;) {
    const pid_t done = ::waitpid(child, &status, WNOHANG);
    if (done == child) break;
    if (done < 0 && errno != EINTR) return "its end was not seen";
    pollfd fd{stop_fd, POLLIN, 0};
    const bool stop = ::poll(&fd, 1, 20) > 0;
    if (stop || Steady::now() >= until) {
      ::kill(-child, SIGKILL);
      ::waitpid(child, &status, 0);
      return stop ? "the farm stops" : fmt::format("took longer than {} s", target.timeout_s);
    }
  }
  if (WIFEXITED(status) && WEXITSTATUS(status) == 0) return {};
  return WIFEXITED(status) ? fmt::format("exit code {}", WEXITSTATUS(status))
                           : fmt::format("ended by signal {}", WTERMSIG(status));
}

}  // namespace

std::string deliver(const NotifyTarget& target, const Notice& notice, const int stop_fd) {
  return target.url.empty() ? run(target, notice, stop_fd) : post(target, notice, stop_fd);
}

}  // namespace slicecorr::farm
