// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "video_file.hpp"

#include <fmt/format.h>
#include <signal.h>
#include <spawn.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <vector>

#include "slicecorr/error.hpp"
#include "support/files/temporary.hpp"

namespace slicecorr::cli {

namespace {

[[noreturn]] void cant_write(const std::string& path, int code) {
  throw DeviceError(fmt::format("{}: can't be written: {}", path, std::strerror(code)));
}

void give_name(detail::Temporary& temporary, const std::string& path) {
  detail::check_may_replace(path);
  detail::put_in_place(temporary, path);
}

class Y4mFile final : public VideoFile {
 public:
  explicit Y4mFile(const std::string& path)
      : path_(path), temporary_{detail::make_temporary(path)} {
    file_ = std::fopen(temporary_.path.c_str(), "wb");
    if (file_ == nullptr) cant_write(path, errno);
  }
  ~Y4mFile() override {
    if (file_ != nullptr) std::fclose(file_);
  }
  void put(const std::uint8_t* bytes, std::size_t count) override {
    if (std::fwrite(bytes, 1, count, file_) != count) cant_write(path_, errno);
  }
  void publish() override {
    std::FILE* const file = file_;
    file_ = nullptr;
    if (std::fclose(file) != 0) cant_write(path_, errno);
    give_name(temporary_, path_);
  }

 private:
  std::string path_;
  detail::Temporary temporary_;
  std::FILE* file_ = nullptr;
};

/// ffmpeg, which reads from a socket: writing to one whose reader has ended is an error, and no
/// signal.
class FfmpegFile final : public VideoFile {
 public:
  /// `kind`: how it is coded, and in what kind of file.
  FfmpegFile(const std::string& path, const std::vector<std::string>& kind)
      : path_(path), temporary_{detail::make_temporary(path)} {
    int ends[2];
    if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) cant_write(path, errno);
    stream_ = ends[0];
    // No times and no versions are written: the same job gives the same bytes.
    std::vector<std::string> words{"ffmpeg", "-hide_banner", "-loglevel", "error", "-y",
                                   "-f",     "yuv4mpegpipe", "-i",        "pipe:0"};
    words.insert(words.end(), kind.begin(), kind.end());
    words.insert(words.end(),
                 {"-fflags", "+bitexact", "-flags:v", "+bitexact", "file:" + temporary_.path});
    std::vector<char*> argv;
    argv.reserve(words.size() + 1);
    for (std::string& w : words) argv.push_back(w.data());
    argv.push_back(nullptr);
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDIN_FILENO);
    // Its words, should it have any, are for people: to stderr.
    posix_spawn_file_actions_adddup2(&actions, STDERR_FILENO, STDOUT_FILENO);
    const int code = ::posix_spawnp(&pid_, "ffmpeg", &actions, nullptr, argv.data(), environ);
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    if (code == 0) return;
    pid_ = -1;
    ::close(stream_);
    stream_ = -1;
    if (code == ENOENT || code == EACCES) {
      throw InputError(path, "",
                       "the program ffmpeg, which makes such files, is not there; expected it "
                       "in the search path (Debian: apt-get install ffmpeg), or a name that ends "
                       "in .y4m");
    }
    throw DeviceError(fmt::format("ffmpeg can't be run: {}", std::strerror(code)));
  }
  ~FfmpegFile() override {
    if (stream_ >= 0) ::close(stream_);
    if (pid_ < 0) return;
    ::kill(pid_, SIGKILL);
    wait();
  }
  void put(const std::uint8_t* bytes, std::size_t count) override {
    while (count > 0) {
      const ssize_t sent = ::send(stream_, bytes, count, MSG_NOSIGNAL);
      if (sent < 0 && errno == EINTR) continue;
      if (sent < 0) ended();
      bytes += sent;
      count -= static_cast<std::size_t>(sent);
    }
  }
  void publish() override {
    ::close(stream_);
    stream_ = -1;
    if (wait() != 0) ended();
    give_name(temporary_, path_);
  }

 private:
  /// Its exit code; -1 when a signal ended it.
  int wait() {
    int status = 0;
    while (pid_ >= 0 && ::waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
    }
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  [[noreturn]] void ended() const {
    throw DeviceError(path_ + ": ffmpeg ended before the video was whole; what it said is above");
  }

  std::string path_;
  detail::Temporary temporary_;
  int stream_ = -1;
  pid_t pid_ = -1;
};

}  // namespace

std::unique_ptr<VideoFile> make_y4m_file(const std::string& path) {
  return std::make_unique<Y4mFile>(path);
}

std::unique_ptr<VideoFile> make_matroska_file(const std::string& path, VideoChannel channel) {
  // Each image is a key image of its own; grey of full range stays what it is.
  std::vector<std::string> kind{"-c:v", "ffv1", "-level", "3", "-g", "1", "-color_range", "pc"};
  switch (channel) {
    case VideoChannel::all:
      kind.insert(kind.end(), {"-pix_fmt", "gray"});
      break;
    case VideoChannel::red:
      kind.insert(kind.end(), {"-vf", "format=gbrp,lutrgb=g=0:b=0", "-pix_fmt", "bgr0"});
      break;
    case VideoChannel::green:
      kind.insert(kind.end(), {"-vf", "format=gbrp,lutrgb=r=0:b=0", "-pix_fmt", "bgr0"});
      break;
    case VideoChannel::blue:
      kind.insert(kind.end(), {"-vf", "format=gbrp,lutrgb=r=0:g=0", "-pix_fmt", "bgr0"});
      break;
  }
  kind.insert(kind.end(), {"-f", "matroska"});
  return std::make_unique<FfmpegFile>(path, kind);
}

std::unique_ptr<VideoFile> make_mp4_file(const std::string& path) {
  return std::make_unique<FfmpegFile>(
      path, std::vector<std::string>{"-vf", "scale=in_range=full:out_range=tv", "-c:v", "libx264",
                                     "-crf", "4", "-pix_fmt", "yuv420p", "-color_range", "tv",
                                     "-movflags", "+faststart", "-f", "mp4"});
}

}  // namespace slicecorr::cli
