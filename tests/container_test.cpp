// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include "stack/container/container.hpp"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <functional>

#include "file_size_limit.hpp"
#include "stack/container/container_output.hpp"
#include "stack/container/folder_container.hpp"
#include "stack/container/tar_container.hpp"
#include "stack/formats/known_foreign.hpp"
#include "tar_fixture.hpp"

namespace slicecorr {
namespace {

using detail::Container;
using detail::ContainerKind;
using detail::ContainerOutput;
using test::Bytes;
using test::TarEntry;
using test::TemporaryFolder;
using testing::HasSubstr;

constexpr std::uint64_t kAnySize = ~std::uint64_t{0};

Bytes pattern(std::size_t size, unsigned seed) {
  std::mt19937 random(seed);
  Bytes bytes(size);
  for (auto& b : bytes) b = static_cast<std::uint8_t>(random());
  return bytes;
}

std::vector<std::string> names_of(const Container& archive) {
  std::vector<std::string> names;
  for (const Container::Entry& e : archive.entries()) names.push_back(e.name);
  return names;
}

Bytes read_entry(const Container& archive, const std::string& name) {
  Bytes bytes;
  const Container::Entry* const entry = archive.find(name);
  EXPECT_NE(entry, nullptr) << name;
  if (entry != nullptr) archive.read(*entry, kAnySize, bytes);
  return bytes;
}

/// The message of the `InputError` that `f` throws; a failure when it throws none.
template <class Exception = InputError>
std::string message_of(const std::function<void()>& f) {
  try {
    f();
  } catch (const Exception& error) {
    return error.what();
  }
  ADD_FAILURE() << "no error";
  return "";
}

// ---- tar.gz --------------------------------------------------------------------------------

class TarGz : public testing::Test {
 protected:
  std::unique_ptr<Container> open(const std::string& name, const ExecutionContext& context = {}) {
    return detail::open_tar_gz(folder_ / name, folder_.path(), context);
  }
  std::string refused(const Bytes& bytes) {
    test::write_file(folder_ / "bad.tar.gz", bytes);
    const std::string message = message_of([&] { open("bad.tar.gz"); });
    EXPECT_THAT(message, HasSubstr(folder_ / "bad.tar.gz"));
    return message;
  }
  TemporaryFolder folder_;
};

TEST_F(TarGz, ReadsAnyEntry) {
  const Bytes large = pattern(3 << 20, 1), small = pattern(777, 2);
  test::make_tar_gz(folder_ / "a.tar.gz", {{"./", {}, '5', 0755},
                                           {"./z.png", large},
                                           {"sub/", {}, '5'},
                                           {"empty", {}},
                                           {"sub/a", small}});
  const auto archive = open("a.tar.gz");
  EXPECT_EQ(archive->kind(), ContainerKind::tar_gz);
  EXPECT_EQ(names_of(*archive), (std::vector<std::string>{"empty", "sub/a", "z.png"}));
  EXPECT_EQ(archive->find("sub/a")->bytes, 777u);
  std::vector<Bytes> read(60);
  parallel_for({}, "read", read.size(), [&](std::size_t i) {
    read[i] = read_entry(*archive, i % 3 == 0 ? "z.png" : i % 3 == 1 ? "sub/a" : "empty");
  });
  for (std::size_t i = 0; i < read.size(); ++i) {
    EXPECT_TRUE(read[i] == (i % 3 == 0 ? large : i % 3 == 1 ? small : Bytes{})) << i;
  }
  Bytes out;
  EXPECT_THAT(message_of([&] { archive->read(*archive->find("sub/a"), 776, out); }),
              HasSubstr("sub/a: entry has 777 bytes, expected at most 776"));
}

TEST_F(TarGz, ReadsWhatTarMakes) {
  std::filesystem::create_directory(folder_ / "in");
  const std::string long_name = std::string(140, 'n') + ".png";
  test::write_file(folder_ / "in/slice_1.png", pattern(5000, 3));
  test::write_file(folder_ / ("in/" + long_name), pattern(10, 4));
  test::write_file(folder_ / "in/gr\xc3\xbc\xc3\x9f.txt", pattern(20, 5));
  for (const std::string format : {"gnu", "pax", "posix"}) {
    const std::string command = "tar --format=" + format + " -czf '" + (folder_ / "t.tar.gz") +
                                "' -C '" + (folder_ / "in") + "' .";
    ASSERT_EQ(std::system(command.c_str()), 0) << command;
    const auto archive = open("t.tar.gz");
    EXPECT_EQ(names_of(*archive),
              (std::vector<std::string>{"gr\xc3\xbc\xc3\x9f.txt", long_name, "slice_1.png"}))
        << format;
    EXPECT_EQ(read_entry(*archive, long_name), pattern(10, 4));
    EXPECT_EQ(read_entry(*archive, "gr\xc3\xbc\xc3\x9f.txt"), pattern(20, 5));
  }
}

TEST_F(TarGz, ReadsAGzipOfSeveralParts) {
  const Bytes tar = test::make_tar({{"a", pattern(3000, 6)}, {"b", pattern(900, 7)}});
  Bytes parts;
  for (std::size_t start = 0; start < tar.size(); start += 1000) {
    const Bytes part = test::gzip(
        Bytes(tar.begin() + static_cast<std::ptrdiff_t>(start),
              tar.begin() + static_cast<std::ptrdiff_t>(std::min(start + 1000, tar.size()))));
    parts.insert(parts.end(), part.begin(), part.end());
  }
  test::write_file(folder_ / "a.tar.gz", parts);
  EXPECT_EQ(read_entry(*open("a.tar.gz"), "b"), pattern(900, 7));
}

TEST_F(TarGz, LargeOnesGoToScratchAsAnnounced) {
  const Bytes large = pattern(33 << 20, 8);
  test::write_file(folder_ / "a.tar.gz",
                   test::gzip(test::make_tar({{"a", large}, {"b", large}}), 0));
  std::vector<std::string> notices;
  ExecutionContext context;
  context.notice = [&](const std::string& text) { notices.push_back(text); };
  const auto archive = open("a.tar.gz", context);
  ASSERT_EQ(notices.size(), 1u);
  EXPECT_THAT(notices[0], HasSubstr("scratch"));
  EXPECT_EQ(folder_.count(), 1) << "scratch has a name";
  EXPECT_TRUE(read_entry(*archive, "b") == large);
}

TEST_F(TarGz, RefusesBombs) {
  // Tar and gzip are sound: 257 members of gzip, each an entry of 1 MiB of zeros in 1 kB.
  const Bytes entry = test::gzip(test::tar_blocks({"a", Bytes(1 << 20)}));
  Bytes bomb;
  for (int n = 0; n < 257; ++n) bomb.insert(bomb.end(), entry.begin(), entry.end());
  const Bytes end = test::gzip(Bytes(1024));
  bomb.insert(bomb.end(), end.begin(), end.end());
  EXPECT_THAT(refused(bomb), HasSubstr("unpacks to more than 268435456 bytes, 500 times its size"));
}

TEST_F(TarGz, RefusesStrangeEntries) {
  struct Case {
    TarEntry entry;
    std::string expected;
  };
  const Bytes x{'x'};
  const std::vector<Case> cases{
      {{"/etc/passwd", x}, "leaves the archive"},
      {{"../a", x}, "leaves the archive"},
      {{"./../a", x}, "leaves the archive"},
      {{"a/../../b", x}, "leaves the archive"},
      {{"a\\b", x}, "leaves the archive"},
      {{"..", {}, '5'}, "leaves the archive"},
      {{"l", {}, '2', 0777, 0, 0, 0, "", "", "/etc/passwd"}, "l: is a link"},
      {{"l", {}, '1', 0644, 0, 0, 0, "", "", "first"}, "l: is a link"},
      {{"c", {}, '3'}, "c: is a device"},
      {{"b", {}, '4'}, "b: is a device"},
      {{"p", {}, '6'}, "p: is a device"},
      {{"first", x}, "first: is there more than once"},
      {{"./first", x}, "first: is there more than once"},
      {{"a\x1b[2Jb/../..", x}, "a?[2Jb"},
  };
  for (const Case& c : cases) {
    SCOPED_TRACE(c.entry.name);
    EXPECT_THAT(refused(test::gzip(test::make_tar({{"first", x}, c.entry}))),
                HasSubstr(c.expected));
  }
}

TEST_F(TarGz, RefusesDamage) {
  const Bytes tar = test::make_tar({{"a", pattern(3000, 9)}, {"b", pattern(100, 10)}});
  const Bytes sound = test::gzip(tar);
  const auto with = [](Bytes bytes, std::size_t at, std::uint8_t value) {
    bytes[at] ^= value;
    return bytes;
  };
  const auto joined = [](Bytes a, const Bytes& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  };
  EXPECT_THAT(refused({}), HasSubstr("damaged"));
  EXPECT_THAT(refused({0x1f, 0x8b}), HasSubstr("damaged"));
  EXPECT_THAT(refused(test::to_bytes("PK is no gzip")), HasSubstr("damaged"));
  EXPECT_THAT(refused(test::gzip({})), HasSubstr("tar"));
  EXPECT_THAT(refused(test::gzip(test::to_bytes("solid cube\nendsolid\n"))), HasSubstr("tar"));
  EXPECT_THAT(refused(with(sound, sound.size() - 1, 1)), HasSubstr("damaged"));  // length
  EXPECT_THAT(refused(with(sound, sound.size() - 7, 1)), HasSubstr("damaged"));  // checksum
  EXPECT_THAT(refused(joined(sound, {0})), HasSubstr("behind the end of the compressed"));
  EXPECT_THAT(refused(joined(sound, test::to_bytes("junk"))), HasSubstr("behind the end"));
  EXPECT_THAT(refused(joined(sound, {0x1f, 0x8b})), HasSubstr("damaged"));
  EXPECT_THAT(refused(joined(sound, test::gzip(test::to_bytes("more")))),
              HasSubstr("behind the end of the tar"));
  EXPECT_THAT(refused(joined(sound, sound)), HasSubstr("behind the end of the tar"));
  // Headers whose sum is right say wrong things; the gzip around them is sound.
  EXPECT_THAT(refused(test::gzip(with(tar, 5, 1))), HasSubstr("tar"));
  EXPECT_THAT(refused(test::gzip(with(tar, 512 + 3072 + 5, 1))), HasSubstr("tar"));
  Bytes cut(tar.begin(), tar.begin() + 512 + 1500);
  EXPECT_THAT(refused(test::gzip(cut)), HasSubstr("tar"));
  for (std::size_t n = 0; n < sound.size(); n += n < 40 || n + 40 > sound.size() ? 1 : 101) {
    SCOPED_TRACE(n);
    refused(Bytes(sound.begin(), sound.begin() + static_cast<std::ptrdiff_t>(n)));
  }
  // Any bit of the gzip: refused, or without effect (time, system, which zeros a run repeats).
  int read = 0;
  for (std::size_t at = 0; at < sound.size(); at += 7) {
    test::write_file(folder_ / "bad.tar.gz",
                     with(sound, at, static_cast<std::uint8_t>(1u << at % 8)));
    try {
      const auto archive = open("bad.tar.gz");
      EXPECT_EQ(read_entry(*archive, "a"), pattern(3000, 9)) << at;
      EXPECT_EQ(read_entry(*archive, "b"), pattern(100, 10)) << at;
      ++read;
    } catch (const InputError&) {
    }
  }
  EXPECT_LT(read, 10);
}

TEST_F(TarGz, NewOnesArePlainAndTheSameEachTime) {
  for (const char* name : {"a.tar.gz", "b.tar.gz"}) {
    const auto output = detail::make_tar_gz_output(folder_ / name, "");
    output->add_text("settings", "{}");
    output->add_lazily({"s/2", "s/1"}, {2000000, 3}, [](std::size_t i, Bytes& data) {
      data = pattern(i == 0 ? 2000000 : 3, static_cast<unsigned>(i));
    });
    output->finish({});
  }
  const Bytes bytes = test::read_file(folder_ / "a.tar.gz");
  EXPECT_EQ(bytes, test::read_file(folder_ / "b.tar.gz"));
  ASSERT_GE(bytes.size(), 10u);
  EXPECT_EQ(Bytes(bytes.begin(), bytes.begin() + 8), (Bytes{0x1f, 0x8b, 8, 0, 0, 0, 0, 0}))
      << "no name, no time";
  constexpr long first_of_1980 = 315532800;
  EXPECT_EQ(
      test::read_tar_gz(folder_ / "a.tar.gz"),
      (std::vector<TarEntry>{{"settings", test::to_bytes("{}"), '0', 0644, 0, 0, first_of_1980},
                             {"s/2", pattern(2000000, 0), '0', 0644, 0, 0, first_of_1980},
                             {"s/1", pattern(3, 1), '0', 0644, 0, 0, first_of_1980}}));
  EXPECT_EQ(folder_.count(), 2);
  EXPECT_EQ(read_entry(*open("a.tar.gz"), "s/1"), pattern(3, 1));
  const std::string list = "tar -tzf '" + (folder_ / "a.tar.gz") + "' >/dev/null";
  EXPECT_EQ(std::system(list.c_str()), 0);
}

TEST_F(TarGz, KeepsWhatIsNotChanged) {
  const std::vector<TarEntry> before{
      {"./", {}, '5', 0750, 1000, 100, 1400000000, "jane", "users"},
      {"./notes", pattern(700, 1), '0', 0600, 1000, 100, 1400000001, "jane", "users"},
      {"./2.png", pattern(500, 2), '0', 0777, 0, 0, 1400000002, "root", "root"},
      {"deep/", {}, '5', 0755, 3, 4, 1400000003},
      {"deep/x", {}, '0', 0644, 5, 6, 1400000004},
      {"1.png", pattern(900, 3), '0', 0444, 7, 8, 1400000005}};
  test::make_tar_gz(folder_ / "a.tar.gz", before);
  ::chmod((folder_ / "a.tar.gz").c_str(), 0640);
  std::vector<TarEntry> after = before;
  after[2].data = pattern(1200, 12);
  after[5].data = pattern(5, 11);
  after.push_back({"3.png", pattern(30, 13), '0', 0644, 0, 0, 315532800});
  for (const char* name : {"b.tar.gz", "a.tar.gz"}) {
    const auto output = detail::make_tar_gz_output(folder_ / name, folder_ / "a.tar.gz");
    output->add_lazily({"1.png", "2.png", "3.png"}, {5, 1200, 30}, [](std::size_t i, Bytes& data) {
      constexpr std::size_t sizes[] = {5, 1200, 30};
      data = pattern(sizes[i], static_cast<unsigned>(11 + i));
    });
    output->finish({});
    EXPECT_EQ(test::read_tar_gz(folder_ / name), after) << name;
    struct stat status;
    ASSERT_EQ(::stat((folder_ / name).c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0640u);
  }
  EXPECT_EQ(folder_.count(), 2);
}

TEST_F(TarGz, KeepsNamesThatPlainHeadersCantSay) {
  std::filesystem::create_directory(folder_ / "in");
  const std::string long_name = std::string(200, 'n') + ".png", odd_name = "gr\xc3\xbc\xc3\x9f.txt";
  test::write_file(folder_ / "in/slice_1.png", pattern(5000, 3));
  test::write_file(folder_ / ("in/" + long_name), pattern(10, 4));
  test::write_file(folder_ / ("in/" + odd_name), pattern(20, 5));
  for (const std::string format : {"gnu", "pax"}) {
    SCOPED_TRACE(format);
    const std::string path = folder_ / "t.tar.gz", out = folder_ / ("out-" + format);
    std::string command =
        "tar --format=" + format + " -czf '" + path + "' -C '" + (folder_ / "in") + "' .";
    ASSERT_EQ(std::system(command.c_str()), 0);
    const auto output = detail::make_tar_gz_output(path, path);
    output->add("slice_1.png", pattern(77, 6));
    output->finish({});
    const auto archive = open("t.tar.gz");
    EXPECT_EQ(names_of(*archive), (std::vector<std::string>{odd_name, long_name, "slice_1.png"}));
    EXPECT_EQ(read_entry(*archive, "slice_1.png"), pattern(77, 6));
    EXPECT_EQ(read_entry(*archive, odd_name), pattern(20, 5));
    std::filesystem::create_directory(out);
    command = "tar -xzf '" + path + "' -C '" + out + "'";
    ASSERT_EQ(std::system(command.c_str()), 0);
    EXPECT_EQ(test::read_file(out + "/" + long_name), pattern(10, 4));
    EXPECT_EQ(test::read_file(out + "/" + odd_name), pattern(20, 5));
    EXPECT_EQ(test::read_file(out + "/slice_1.png"), pattern(77, 6));
  }
}

TEST_F(TarGz, FailuresLeaveTheOldOne) {
  test::make_tar_gz(folder_ / "a.tar.gz", {{"a", pattern(100, 1)}});
  const Bytes before = test::read_file(folder_ / "a.tar.gz");
  const auto write = [&](const ContainerOutput::Fill& fill, const ExecutionContext& context = {}) {
    const auto output = detail::make_tar_gz_output(folder_ / "a.tar.gz", folder_ / "a.tar.gz");
    output->add_lazily({"a", "b"}, {10, 3 << 20}, fill);
    output->finish(context);
  };
  const auto sound = [](std::size_t i, Bytes& data) { data = pattern(i == 0 ? 10 : 3 << 20, 2); };
  EXPECT_THROW(write([&](std::size_t i, Bytes& data) {
                 if (i == 1) throw InputError("stop");
                 sound(i, data);
               }),
               InputError);
  std::atomic<bool> cancel{false};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(write(
                   [&](std::size_t i, Bytes& data) {
                     cancel = true;
                     sound(i, data);
                   },
                   context),
               Cancelled);
  {
    const test::FileSizeLimit limit(1 << 20);
    EXPECT_THAT(message_of<DeviceError>([&] { write(sound); }), HasSubstr("can't be written"));
  }
  EXPECT_EQ(test::read_file(folder_ / "a.tar.gz"), before);
  EXPECT_EQ(folder_.count(), 1);
  EXPECT_THROW(detail::make_tar_gz_output(folder_ / "none/a.tar.gz", ""), DeviceError);
  EXPECT_THROW(detail::make_tar_gz_output(folder_.path(), ""), DeviceError);
}

// ---- folders -------------------------------------------------------------------------------

class Folder : public testing::Test {
 protected:
  /// Files of a folder below `folder_`, names with one slash at the most.
  void make(const std::string& name, const test::Entries& files) {
    std::filesystem::create_directories(folder_ / name);
    for (const auto& [file, data] : files) {
      const std::string path = folder_ / (name + "/" + file);
      std::filesystem::create_directories(std::filesystem::path(path).parent_path());
      test::write_file(path, data);
    }
  }
  std::map<std::string, Bytes> files(const std::string& name) const {
    std::map<std::string, Bytes> found;
    for (const auto& e : std::filesystem::recursive_directory_iterator(folder_ / name)) {
      if (!e.is_regular_file()) continue;
      found[std::filesystem::relative(e.path(), folder_ / name).string()] =
          test::read_file(e.path().string());
    }
    return found;
  }
  void write(const std::string& name, const std::string& keep_from, const test::Entries& entries) {
    const auto output =
        detail::make_folder_output(folder_ / name, keep_from.empty() ? "" : folder_ / keep_from);
    EXPECT_EQ(output->folder(), folder_.path());
    for (const auto& [file, data] : entries) output->add(file, data);
    output->finish({});
  }
  ino_t inode(const std::string& name) const {
    struct stat status;
    EXPECT_EQ(::stat((folder_ / name).c_str(), &status), 0) << name;
    return status.st_ino;
  }
  TemporaryFolder folder_;
  const Bytes a_ = pattern(100, 1), b_ = pattern(200, 2), c_ = pattern(300, 3);
};

TEST_F(Folder, ReadsFilesButFollowsNoLinks) {
  make("in", {{"2.png", a_}, {"1.png", b_}, {"uv/1.png", c_}, {"empty", {}}, {"deep/er/x", a_}});
  test::write_file(folder_ / "secret", c_);
  std::filesystem::create_symlink("../secret", folder_ / "in/link.png");
  std::filesystem::create_directory_symlink("..", folder_ / "in/out");
  ASSERT_EQ(::mkfifo((folder_ / "in/pipe").c_str(), 0600), 0);
  for (const std::string& path : {folder_ / "in", folder_ / "in//"}) {
    const auto archive = detail::open_folder(path);
    EXPECT_EQ(archive->kind(), ContainerKind::folder);
    EXPECT_EQ(names_of(*archive),
              (std::vector<std::string>{"1.png", "2.png", "empty", "uv/1.png"}));
    EXPECT_EQ(read_entry(*archive, "uv/1.png"), c_);
    EXPECT_EQ(read_entry(*archive, "2.png"), a_);
    EXPECT_EQ(read_entry(*archive, "empty"), Bytes{});
    Bytes out;
    EXPECT_THAT(message_of([&] { archive->read(*archive->find("1.png"), 199, out); }),
                HasSubstr("1.png: file has 200 bytes, expected at most 199"));
  }
  EXPECT_THAT(message_of([&] { detail::open_folder(folder_ / "none"); }),
              HasSubstr("No such file"));
  EXPECT_THAT(message_of([&] { detail::open_folder(folder_ / "secret"); }),
              HasSubstr("Not a directory"));
}

TEST_F(Folder, WhatChangesAfterOpeningIsRefused) {
  make("in", {{"1.png", a_}, {"2.png", a_}, {"3.png", a_}, {"uv/1.png", a_}});
  test::write_file(folder_ / "secret", a_);
  const auto archive = detail::open_folder(folder_ / "in");
  test::write_file(folder_ / "in/1.png", b_);
  std::filesystem::remove(folder_ / "in/2.png");
  std::filesystem::create_symlink(folder_ / "secret", folder_ / "in/2.png");
  std::filesystem::remove(folder_ / "in/3.png");
  ASSERT_EQ(::mkfifo((folder_ / "in/3.png").c_str(), 0600), 0);
  std::filesystem::remove_all(folder_ / "in/uv");
  make("other", {{"1.png", a_}});
  std::filesystem::create_directory_symlink(folder_ / "other", folder_ / "in/uv");
  Bytes out;
  for (const std::string name : {"1.png", "2.png", "3.png", "uv/1.png"}) {
    EXPECT_THROW(archive->read(*archive->find(name), kAnySize, out), InputError) << name;
  }
}

TEST_F(Folder, NewOnes) {
  for (const std::string name : {"new", "slash/"}) {
    write(name, "", {{"0.png", a_}, {"uv/0.png", b_}, {"uv/1.png", c_}});
    EXPECT_EQ(files(name),
              (std::map<std::string, Bytes>{{"0.png", a_}, {"uv/0.png", b_}, {"uv/1.png", c_}}));
  }
  std::filesystem::create_directory(folder_ / "empty");
  write("empty", "", {{"0.png", a_}});
  EXPECT_EQ(files("empty"), (std::map<std::string, Bytes>{{"0.png", a_}}));
  EXPECT_EQ(folder_.count(), 3) << "something is left over";
}

TEST_F(Folder, KeepsWhatIsNotChanged) {
  make("in", {{"1.png", a_}, {"2.png", b_}, {"notes.txt", c_}, {"uv/1.png", c_}});
  std::filesystem::create_directory(folder_ / "in/nothing");
  ::chmod((folder_ / "in/1.png").c_str(), 0640);
  ::chmod((folder_ / "in/notes.txt").c_str(), 0440);
  ::chmod((folder_ / "in").c_str(), 0750);
  const timespec times[2] = {{1400000000, 0}, {1400000000, 123456789}};
  ASSERT_EQ(::utimensat(AT_FDCWD, (folder_ / "in/notes.txt").c_str(), times, 0), 0);
  const std::map<std::string, Bytes> before = files("in");
  const ino_t notes = inode("in/notes.txt");
  std::map<std::string, Bytes> after = before;
  after["1.png"] = c_;
  after["3.png"] = a_;
  for (const std::string name : {"out", "in"}) {
    write(name, "in", {{"1.png", c_}, {"3.png", a_}});
    EXPECT_EQ(files(name), after);
    EXPECT_TRUE(std::filesystem::is_directory(folder_ / (name + "/nothing")));
    struct stat status;
    ASSERT_EQ(::stat((folder_ / (name + "/notes.txt")).c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0440u);
    EXPECT_EQ(status.st_mtim.tv_sec, 1400000000);
    EXPECT_EQ(status.st_mtim.tv_nsec, 123456789);
    // In place the same file; else another, so that changing one in place leaves the other.
    EXPECT_EQ(status.st_ino == notes, name == "in");
    ASSERT_EQ(::stat((folder_ / (name + "/1.png")).c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0640u);
    ASSERT_EQ(::stat((folder_ / name).c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777, 0750u);
    if (name == "out") {
      EXPECT_EQ(files("in"), before);
    }
  }
  EXPECT_EQ(folder_.count(), 2);
}

TEST_F(Folder, ALinkToAFolderStaysALink) {
  make("real", {{"1.png", a_}});
  std::filesystem::create_directory_symlink("real", folder_ / "link");
  write("link", "link", {{"1.png", b_}});
  EXPECT_TRUE(std::filesystem::is_symlink(folder_ / "link"));
  EXPECT_EQ(files("real"), (std::map<std::string, Bytes>{{"1.png", b_}}));
}

TEST_F(Folder, OnlyOurOwnAreReplaced) {
  const Bytes json = test::to_bytes("{}");
  make("ours", {{"slicecorr.json", json},
                {"00000000.png", a_},
                {"00000001.png", a_},
                {"uv/00000000.png", a_}});
  write("ours", "", {{"0.png", b_}});
  EXPECT_EQ(files("ours"), (std::map<std::string, Bytes>{{"0.png", b_}}));

  const auto refused = [&](const std::string& name, const std::string& keep_from,
                           const std::string& expected) {
    const auto before = files(name);
    EXPECT_THAT(message_of([&] { write(name, keep_from, {{"0.png", b_}}); }), HasSubstr(expected));
    EXPECT_EQ(files(name), before);
  };
  make("foreign", {{"0.png", a_}});
  refused("foreign", "", "was not written by slicecorr");
  make("kept", {{"0.png", a_}, {"notes.txt", b_}});
  refused("foreign", "kept", "was not written by slicecorr");
  make("mixed", {{"slicecorr.json", json}, {"0.png", a_}, {"thesis.txt", b_}});
  refused("mixed", "", "thesis.txt: was not written by slicecorr");
  refused("mixed", "kept", "thesis.txt: was not written by slicecorr");
  make("nested", {{"slicecorr.json", json}, {"photos/me.png", b_}});
  refused("nested", "", "photos/me.png: was not written by slicecorr");
  make("deep", {{"slicecorr.json", json}, {"uv/more/0.png", b_}});
  refused("deep", "", "uv/more: is a link or lies deeper");
  make("linked", {{"slicecorr.json", json}});
  std::filesystem::create_symlink("../kept", folder_ / "linked/0.png");
  refused("linked", "", "linked: 0.png: is a link or lies deeper");
  refused("linked", "linked", "0.png: is a link or lies deeper");
  // What an earlier run kept from the same folder is no obstacle.
  make("again", {{"slicecorr.json", json}, {"0.png", a_}, {"notes.txt", b_}});
  write("again", "kept", {{"0.png", c_}});
  EXPECT_EQ(files("again"), (std::map<std::string, Bytes>{{"0.png", c_}, {"notes.txt", b_}}));

  test::write_file(folder_ / "file", a_);
  EXPECT_THAT(message_of([&] { write("file", "", {}); }), HasSubstr("is a file"));
  EXPECT_THAT(
      message_of([&] { detail::make_folder_output(folder_ / "kept/out", folder_ / "kept"); }),
      HasSubstr("lies in the folder that is kept"));
  EXPECT_THAT(message_of([&] { detail::make_folder_output(folder_ / "kept/..", ""); }),
              HasSubstr("can't be replaced"));
  EXPECT_THAT(message_of([&] { detail::make_folder_output(".", ""); }), HasSubstr("can't be"));
  EXPECT_THAT(message_of([&] { detail::make_folder_output("/", ""); }), HasSubstr("can't be"));
  EXPECT_THROW(detail::make_folder_output(folder_ / "none/out", ""), DeviceError);
}

TEST_F(Folder, FailuresLeaveTheOldOne) {
  make("in", {{"1.png", a_}, {"2.png", b_}, {"notes.txt", c_}});
  const auto before = files("in");
  const auto write_with = [&](const ContainerOutput::Fill& fill,
                              const ExecutionContext& context = {}) {
    const auto output = detail::make_folder_output(folder_ / "in", folder_ / "in");
    output->add_lazily({"1.png", "2.png", "3.png"}, {10, 20, 30}, fill);
    output->finish(context);
  };
  const auto sound = [](std::size_t i, Bytes& data) { data = pattern(10 * (i + 1), 7); };
  EXPECT_THROW(write_with([&](std::size_t i, Bytes& data) {
                 if (i == 2) throw InputError("stop");
                 sound(i, data);
               }),
               InputError);
  std::atomic<bool> cancel{false};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(write_with(
                   [&](std::size_t i, Bytes& data) {
                     cancel = i == 2;
                     sound(i, data);
                   },
                   context),
               Cancelled);
  EXPECT_EQ(files("in"), before);
  EXPECT_EQ(folder_.count(), 1);

  // Killed: what it began is left over under a name of its own, the folder is as it was.
  const pid_t child = ::fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    write_with([&](std::size_t i, Bytes& data) {
      if (i == 2) ::kill(::getpid(), SIGKILL);
      sound(i, data);
    });
    ::_exit(0);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  EXPECT_EQ(files("in"), before);
  int left_over = 0;
  for (const auto& e : std::filesystem::directory_iterator(folder_.path())) {
    const auto name = detail::temporary_name(e.path().filename().string());
    left_over += name ? 1 : 0;
    if (name) {
      EXPECT_EQ(name->maker.pid, child);
    }
  }
  EXPECT_EQ(left_over, 1);

  // A file that comes while the folder is written must not go with the old one.
  EXPECT_THAT(message_of([&] {
                write_with([&](std::size_t i, Bytes& data) {
                  if (i == 2) test::write_file(folder_ / "in/new.txt", a_);
                  sound(i, data);
                });
              }),
              HasSubstr("new.txt: was added while the folder was written"));
  auto with_new = before;
  with_new["new.txt"] = a_;
  EXPECT_EQ(files("in"), with_new);

  write_with(sound);
  EXPECT_EQ(files("in").at("3.png"), pattern(30, 7));
  EXPECT_EQ(files("in").at("new.txt"), a_);
}

// ---- what is known and can't be read ---------------------------------------------------------

TEST(KnownForeign, BinaryPrintFilesByTheirFirstBytes) {
  const TemporaryFolder folder;
  const auto refused = [&](const std::string& name, const std::string& start,
                           const std::string& expected) {
    test::write_file(folder / name, test::to_bytes(start + std::string(100, '\0')));
    const std::string message = message_of([&] { detail::container_kind(folder / name); });
    EXPECT_THAT(message, HasSubstr(expected));
    EXPECT_THAT(message, HasSubstr(".sl1"));
    EXPECT_THAT(message, HasSubstr(folder / name));
  };
  using namespace std::string_literals;
  const auto known = [&](const std::string& name, const std::string& start) {
    test::write_file(folder / name, test::to_bytes(start + std::string(100, '\0')));
    EXPECT_EQ(detail::container_kind(folder / name), ContainerKind::binary) << name;
  };
  known("a.bin", "\x19\x00\xfd\x12"s);
  known("a.uvj", "\x86\x00\xfd\x12"s);
  known("b", "\x06\x01\xfd\x12"s);
  known("d.sl1", "ANYCUBIC\0\0\0\0"s);
  known("e", "V3.0\x07\0\0\0DLP\0"s);
  known("f.lys", "Longer3D"s);
  // Of unknown versions the name tells.
  for (const std::string name : {"x.ctb", "x.CBDDLP", "x.photon", "x.pwmx", "x.pwmo", "x.goo",
                                 "x.lys", "x.pm3m", "x.phz", "x.cxdlp"}) {
    refused(name, "something new", "whose layers can't be read");
  }
  // Archives are taken for what they are, and names that only look alike are none.
  test::write_file(folder / "zip.photon", test::to_bytes("PK\x03\x04"));
  EXPECT_EQ(detail::container_kind(folder / "zip.photon"), ContainerKind::zip);
  test::write_file(folder / "a.ctb.gz", {0x1f, 0x8b, 8});
  EXPECT_EQ(detail::container_kind(folder / "a.ctb.gz"), ContainerKind::tar_gz);
  test::write_file(folder / "actb", {1, 2, 3});
  EXPECT_EQ(detail::container_kind(folder / "actb"), ContainerKind::zip);
  EXPECT_EQ(detail::container_kind(folder.path()), ContainerKind::folder);
}

}  // namespace
}  // namespace slicecorr
