#include "stack/zip_output.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <exception>
#include <memory>

#include "base/errno_message.hpp"
#include "slicecorr/error.hpp"

namespace slicecorr::detail {

/// The entry that is being written. Only one is open at a time, so all share one buffer.
struct ZipWriting {
  const Job& job;
  std::vector<std::uint8_t> data;
  std::size_t at = 0;
  /// Thrown by `fill` or by the user's callback: it must not pass through the C library.
  std::exception_ptr error;

  struct Entry {
    ZipWriting* writing;
    const ZipOutput::Source* source;
  };

  void report(double fraction) {
    try {
      job.report("write", std::clamp(fraction, 0.0, 1.0));
    } catch (...) {
      error = std::current_exception();
    }
  }

  bool stopped() const { return error || (job.cancel != nullptr && job.cancel->load()); }

  static zip_int64_t call(void* state, void* data, zip_uint64_t length, zip_source_cmd_t command) {
    const Entry& entry = *static_cast<Entry*>(state);
    return entry.writing->answer(*entry.source, data, length, command);
  }

  zip_int64_t answer(const ZipOutput::Source& source, void* out, zip_uint64_t length,
                     zip_source_cmd_t command) {
    switch (command) {
      case ZIP_SOURCE_OPEN:
        try {
          data.clear();
          at = 0;
          source.fill(source.number, data);
          if (data.size() != source.size) throw Error("an entry has not the promised size");
        } catch (...) {
          error = std::current_exception();
          return -1;
        }
        return 0;
      case ZIP_SOURCE_READ: {
        const std::size_t n = std::min<std::size_t>(length, data.size() - at);
        std::memcpy(out, data.data() + at, n);
        at += n;
        return static_cast<zip_int64_t>(n);
      }
      case ZIP_SOURCE_STAT: {
        auto* const status = static_cast<zip_stat_t*>(out);
        zip_stat_init(status);
        status->size = source.size;
        status->valid = ZIP_STAT_SIZE;
        return sizeof *status;
      }
      case ZIP_SOURCE_ERROR: {
        const int codes[2] = {ZIP_ER_INTERNAL, 0};
        std::memcpy(out, codes, sizeof codes);
        return sizeof codes;
      }
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE,
                                              ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE,
                                              -1);
      case ZIP_SOURCE_CLOSE:
      case ZIP_SOURCE_FREE:
        return 0;
      default:
        return -1;
    }
  }
};

namespace {

/// Removes the temporary file unless it was renamed.
struct Temporary {
  std::string path;
  bool keep = false;
  ~Temporary() {
    if (!keep) ::unlink(path.c_str());
  }
};

/// Waits until the contents are on the disk: a rename must not come before them.
void sync(const std::string& path, int flags) {
  const int file = ::open(path.c_str(), flags | O_CLOEXEC);
  if (file < 0) throw DeviceError(errno_message(path, "can't be opened"));
  const int result = ::fsync(file);
  const int error = errno;
  ::close(file);
  // EINVAL: the file system can't, as is usual for folders on some.
  if (result != 0 && error != EINVAL)
    throw DeviceError(errno_message(path, "can't be written", error));
}

std::string zip_text(zip_error_t* error) {
  // The text of the system alone says more to the user than with the library's in front.
  if (zip_error_system_type(error) == ZIP_ET_SYS && zip_error_code_system(error) != 0) {
    return std::generic_category().message(zip_error_code_system(error));
  }
  return zip_error_strerror(error);
}

}  // namespace

ZipOutput::ZipOutput(const std::string& path) : path_(path) {
  const std::size_t slash = path.rfind('/');
  folder_ = slash == std::string::npos ? "." : slash == 0 ? "/" : path.substr(0, slash);
  file_ = slash == std::string::npos ? path : path.substr(slash + 1);
  struct stat status;
  if (::stat(folder_.c_str(), &status) != 0) {
    throw DeviceError(errno_message(path, "folder of the output can't be used"));
  }
  const bool taken = ::stat(path.c_str(), &status) == 0;
  if (file_.empty() || (taken && !S_ISREG(status.st_mode))) {
    throw DeviceError(path + ": can't be written: is no ordinary file");
  }
  const Temporary trial{make_temporary()};
}

std::string ZipOutput::make_temporary() const {
  static std::atomic<unsigned> counter{0};
  for (int attempt = 0; attempt < 1000; ++attempt) {
    // Cut, because the zip library adds to the name and names have at most 255 bytes.
    const std::string name = folder_ + "/." + file_.substr(0, 200) + "." +
                             std::to_string(::getpid()) + "-" + std::to_string(counter++) + ".part";
    const int file = ::open(name.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0666);
    if (file >= 0) {
      ::close(file);
      return name;
    }
    if (errno != EEXIST) break;
  }
  throw DeviceError(errno_message(path_, "can't be written"));
}

void ZipOutput::add(std::string name, std::vector<std::uint8_t> data) {
  const std::uint64_t size = data.size();
  auto fill = [data = std::move(data)](std::size_t, std::vector<std::uint8_t>& out) { out = data; };
  sources_.push_back({std::move(name), size, std::move(fill), 0});
}

void ZipOutput::add_lazily(const char* names, const std::vector<std::uint64_t>& sizes, Fill fill) {
  // Shared: a million copies of a function would not be small.
  const auto shared = std::make_shared<Fill>(std::move(fill));
  for (std::size_t i = 0; i < sizes.size(); ++i) {
    char name[64];
    std::snprintf(name, sizeof name, names, static_cast<int>(i));
    sources_.push_back(
        {name, sizes[i],
         [shared](std::size_t n, std::vector<std::uint8_t>& out) { (*shared)(n, out); }, i});
  }
}

void ZipOutput::finish(const Job& job) {
  job.check_cancelled();
  Temporary temporary{make_temporary()};
  write(temporary.path, job);
  // The zip library leaves out the last step when it is a small one.
  job.report("write", 1);
  sync(temporary.path, O_WRONLY);
  job.check_cancelled();
  if (::rename(temporary.path.c_str(), path_.c_str()) != 0) {
    throw DeviceError(errno_message(path_, "can't be written"));
  }
  temporary.keep = true;
  sync(folder_, O_RDONLY | O_DIRECTORY);
}

void ZipOutput::write(const std::string& temporary, const Job& job) {
  ZipWriting writing{job, {}, 0, nullptr};
  std::vector<ZipWriting::Entry> entries;
  entries.reserve(sources_.size());  // the library keeps pointers

  zip_error_t error;
  int code = 0;
  zip_t* const zip = zip_open(temporary.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  if (zip == nullptr) throw DeviceError(errno_message(path_, "can't be written"));
  // After the entries: discarding the archive still calls them.
  std::unique_ptr<zip_t, decltype(&zip_discard)> guard(zip, &zip_discard);
  const auto fail = [&](zip_error_t* e) {
    throw DeviceError(path_ + ": can't be written: " + zip_text(e));
  };

  for (const Source& source : sources_) {
    entries.push_back({&writing, &source});
    zip_error_init(&error);
    zip_source_t* const made =
        zip_source_function_create(&ZipWriting::call, &entries.back(), &error);
    if (made == nullptr) fail(&error);
    const zip_int64_t added = zip_file_add(zip, source.name.c_str(), made, ZIP_FL_ENC_UTF_8);
    if (added < 0) {
      zip_source_free(made);
      fail(zip_get_error(zip));
    }
    const auto index = static_cast<zip_uint64_t>(added);
    constexpr zip_uint16_t first_of_1980 = 1 << 5 | 1;
    if (zip_set_file_compression(zip, index, ZIP_CM_STORE, 0) != 0 ||
        zip_file_set_dostime(zip, index, 0, first_of_1980, 0) != 0) {
      fail(zip_get_error(zip));
    }
  }
  const auto on_progress = [](zip_t*, double fraction, void* state) {
    static_cast<ZipWriting*>(state)->report(fraction);
  };
  const auto on_cancel = [](zip_t*, void* state) -> int {
    return static_cast<ZipWriting*>(state)->stopped() ? 1 : 0;
  };
  if (job.progress) {
    zip_register_progress_callback_with_state(zip, 0.01, on_progress, nullptr, &writing);
  }
  zip_register_cancel_callback_with_state(zip, on_cancel, nullptr, &writing);
  if (zip_close(zip) != 0) {
    if (writing.error) std::rethrow_exception(writing.error);
    if (zip_error_code_zip(zip_get_error(zip)) == ZIP_ER_CANCELLED) throw Cancelled();
    fail(zip_get_error(zip));
  }
  (void)guard.release();
}

}  // namespace slicecorr::detail
