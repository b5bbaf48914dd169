// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>
#include <gmock/gmock.h>
#include <unistd.h>
#include <zip.h>
#include <zlib.h>

#include <atomic>
#include <memory>

#include "file_size_limit.hpp"
#include "rounds.hpp"
#include "run_program.hpp"
#include "stack/container/zip_layout.hpp"
#include "stack/container/zip_output.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using detail::ContainerOutput;
using detail::ImagePacking;
using detail::ZipEntry;
using detail::ZipOutput;
using test::operator+;
using test::Bytes;
using test::TemporaryFolder;
using testing::HasSubstr;

constexpr std::uint64_t kGib = std::uint64_t{1} << 30;

Bytes contents(std::size_t i) {
  Bytes data(i % (i < 1000 ? 977 : 13) + 1);
  for (std::size_t k = 0; k < data.size(); ++k) data[k] = static_cast<std::uint8_t>(i * 31 + k / 7);
  return data;
}

void write_zip(const std::string& path, const std::vector<std::string>& names, ImagePacking images,
               const ExecutionContext& context = {}) {
  ZipOutput output(path, "", images);
  std::vector<std::uint64_t> sizes;
  for (std::size_t i = 0; i < names.size(); ++i) sizes.push_back(contents(i).size());
  output.add_lazily(names, sizes, [](std::size_t i, Bytes& data) { data = contents(i); });
  output.finish(context, {});
}

/// The same by the zip library.
void write_reference(const std::string& path, const std::vector<std::string>& names) {
  zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  ASSERT_NE(zip, nullptr);
  std::vector<Bytes> kept;
  for (std::size_t i = 0; i < names.size(); ++i) kept.push_back(contents(i));
  for (std::size_t i = 0; i < names.size(); ++i) {
    zip_source_t* const source = zip_source_buffer(zip, kept[i].data(), kept[i].size(), 0);
    const zip_int64_t index = zip_file_add(zip, names[i].c_str(), source, ZIP_FL_ENC_UTF_8);
    ASSERT_EQ(index, static_cast<zip_int64_t>(i));
    zip_set_file_compression(zip, i, ZIP_CM_STORE, 0);
    zip_file_set_dostime(zip, i, 0, 1 << 5 | 1, 0);
  }
  ASSERT_EQ(zip_close(zip), 0);
}

std::vector<std::string> numbered(std::size_t count) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < count; ++i) names.push_back("s/" + std::to_string(i) + ".png");
  return names;
}

/// What Python's own reader says to a few lines about each archive `z`, indented by one.
std::string python(const std::vector<std::string>& paths, const std::string& lines) {
  const std::string script =
      "import zipfile, sys\nfor path in sys.argv[1:]:\n z = zipfile.ZipFile(path)\n" + lines;
  const test::RunResult result =
      test::run_program(test::Command{"/usr/bin/python3", "-c", script} + paths);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  return result.out;
}

TEST(Zip, HasTheBytesThatTheZipLibraryWrites) {
  const TemporaryFolder folder;
  std::vector<std::string> names = numbered(300);
  names.insert(names.begin(), {"config.json", "Schichten/größe µm.png", "a"});
  write_zip(folder / "a.zip", names, ImagePacking::stored);
  write_reference(folder / "b.zip", names);
  EXPECT_EQ(test::read_file(folder / "a.zip"), test::read_file(folder / "b.zip"));
}

TEST(Zip, SameBytesForAnyNumberOfThreads) {
  const TemporaryFolder folder;
  for (const ImagePacking images : {ImagePacking::stored, ImagePacking::deflated}) {
    ExecutionContext context;
    context.threads = 1;
    write_zip(folder / "one.zip", numbered(500), images, context);
    context.threads = 7;
    write_zip(folder / "seven.zip", numbered(500), images, context);
    EXPECT_EQ(test::read_file(folder / "one.zip"), test::read_file(folder / "seven.zip"));
  }
}

TEST(Zip, DeflatedImagesAreReadByTwoOthers) {
  const TemporaryFolder folder;
  std::vector<std::string> names = numbered(200);
  names[0] = "text.json";
  write_zip(folder / "a.zip", names, ImagePacking::deflated);
  const test::Entries entries = test::unzip(folder / "a.zip");
  ASSERT_EQ(entries.size(), names.size());
  for (std::size_t i = 0; i < names.size(); ++i) {
    EXPECT_EQ(entries[i].first, names[i]);
    EXPECT_EQ(entries[i].second, contents(i)) << i;
  }
  EXPECT_EQ(
      python(
          {folder / "a.zip"},
          " assert z.testzip() is None\n"
          " print(sorted({i.compress_type for i in z.infolist()}), z.infolist()[0].compress_type)"),
      "[0, 8] 0\n");
}

// A directory counts to 65,535 in its plain form.
TEST(Zip, MoreEntriesThanThePlainFormHolds) {
  const TemporaryFolder folder;
  for (const std::size_t count : {65535u, 65536u}) {
    const std::vector<std::string> names = numbered(count);
    write_zip(folder / "a.zip", names, ImagePacking::stored);
    // With exactly 65,535 the library writes the number that means "see the ZIP64 record", and
    // none.
    if (count != 65535) {
      write_reference(folder / "b.zip", names);
      EXPECT_EQ(test::read_file(folder / "a.zip"), test::read_file(folder / "b.zip")) << count;
    }
    zip_t* const zip = zip_open((folder / "a.zip").c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
    ASSERT_NE(zip, nullptr);
    EXPECT_EQ(zip_get_num_entries(zip, 0), static_cast<zip_int64_t>(count));
    zip_discard(zip);
    // Python's reader takes longest: by day it reads the one with the ZIP64 record.
    if (count == 65535 && !test::by_night()) continue;
    EXPECT_EQ(
        python({folder / "a.zip"}, " print(len(z.infolist()), len(z.read(z.infolist()[-1])))"),
        std::to_string(count) + " " + std::to_string(contents(count - 1).size()) + "\n");
  }
}

/// An archive with holes: two entries of `bytes` zeros each, the last of them `gap` bytes later
/// than it could be, and a small one behind.
struct SparseZip {
  SparseZip(const std::string& path, std::uint64_t bytes, std::uint64_t gap) {
    const int file = ::open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY, 0666);
    EXPECT_GE(file, 0);
    const auto write = [&](const Bytes& data, std::uint64_t at) {
      EXPECT_EQ(::pwrite(file, data.data(), data.size(), static_cast<off_t>(at)),
                static_cast<ssize_t>(data.size()));
    };
    // CRC-32 of zeros: twice as many at a time.
    auto crc = static_cast<std::uint32_t>(::crc32(0, reinterpret_cast<const Bytef*>("\0"), 1));
    std::uint64_t have = 1;
    for (int bit = 62 - __builtin_clzll(bytes); bit >= 0; --bit) {
      crc = static_cast<std::uint32_t>(::crc32_combine64(crc, crc, static_cast<z_off64_t>(have)));
      have *= 2;
      if ((bytes >> bit & 1) == 0) continue;
      const Bytes zero(1);
      crc = static_cast<std::uint32_t>(::crc32(crc, zero.data(), 1));
      ++have;
    }
    EXPECT_EQ(have, bytes);
    entries = {
        {"a", bytes, bytes, 0, crc, false},
        {"b", bytes, bytes, 0, crc, false},
        {"c", 3, 3, 0,
         static_cast<std::uint32_t>(::crc32(0, reinterpret_cast<const Bytef*>("xyz"), 3)), false}};
    std::uint64_t at = 0;
    for (ZipEntry& entry : entries) {
      if (entry.name == "b") at += gap;
      entry.offset = at;
      Bytes record;
      append_local_record(entry, record);
      EXPECT_EQ(record.size(), local_record_bytes(entry));
      write(record, at);
      at += record.size();
      if (entry.name == "c") write({'x', 'y', 'z'}, at);
      at += entry.bytes;
    }
    write(zip_directory(entries, at), at);
    ::close(file);
  }
  std::vector<ZipEntry> entries;
};

void expect_read_by_library(const std::string& path, std::uint64_t bytes) {
  zip_t* const zip = zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, nullptr);
  ASSERT_NE(zip, nullptr);
  for (const zip_uint64_t i : {0u, 1u}) {
    zip_stat_t status;
    ASSERT_EQ(zip_stat_index(zip, i, 0, &status), 0);
    EXPECT_EQ(status.size, bytes);
  }
  zip_file_t* const file = zip_fopen(zip, "c", 0);
  ASSERT_NE(file, nullptr);
  char text[4] = {};
  EXPECT_EQ(zip_fread(file, text, 3), 3);
  EXPECT_STREQ(text, "xyz");
  zip_fclose(file);
  zip_discard(zip);
}

/// The zip library and Python read archives whose entries have so many bytes; Python does `more`, too.
void expect_read(const std::vector<std::string>& paths, const std::vector<std::uint64_t>& sizes,
                 const std::string& more = "") {
  std::string expected;
  for (std::size_t i = 0; i < paths.size(); ++i) {
    expect_read_by_library(paths[i], sizes[i]);
    const std::string bytes = std::to_string(sizes[i]);
    expected += "[" + bytes + ", " + bytes + ", 3] b'xyz' b'\\x00\\x00'\n";
  }
  EXPECT_EQ(
      python(
          paths,
          more + " print([i.file_size for i in z.infolist()], z.read('c'), z.open('b').read(2))\n"),
      expected);
}

// Sparse files: they take next to nothing on the disk.
TEST(Zip, EntriesBeyondFourGib) {
  const TemporaryFolder folder;
  std::vector<std::string> paths;
  // Around the last offset that 32 bits can say, which is one less than their largest number.
  for (const std::uint64_t gap :
       {4 * kGib - 31 - 1000 - 2, 4 * kGib - 31 - 1000 - 1, 4 * kGib - 31 - 1000, 9 * kGib}) {
    paths.push_back(folder / ("far-" + std::to_string(gap) + ".zip"));
    const SparseZip zip(paths.back(), 1000, gap);
    EXPECT_EQ(zip.entries[1].offset, gap + 1031);
  }
  expect_read(paths, std::vector<std::uint64_t>(paths.size(), 1000),
              " assert z.testzip() is None\n");
}

TEST(Zip, EntriesOfFourGib) {
  const TemporaryFolder folder;
  const std::vector<std::uint64_t> sizes{4 * kGib - 2, 4 * kGib - 1, 4 * kGib, 5 * kGib + 3};
  std::vector<std::string> paths;
  for (const std::uint64_t bytes : sizes) {
    paths.push_back(folder / ("large-" + std::to_string(bytes) + ".zip"));
    const SparseZip zip(paths.back(), bytes, 0);
  }
  expect_read(paths, sizes);
}

TEST(Zip, NamesTooLongForTheFormatAreRefused) {
  Bytes out;
  ZipEntry entry;
  entry.name.assign(65535, 'n');
  append_local_record(entry, out);
  entry.name += 'n';
  EXPECT_THROW(append_local_record(entry, out), std::invalid_argument);
}

TEST(Zip, FailuresLeaveTheOldOne) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.zip";
  for (const ImagePacking images : {ImagePacking::stored, ImagePacking::deflated}) {
    write_zip(path, {"old.png"}, images);
    const Bytes before = test::read_file(path);
    const auto write = [&](std::uint64_t last_size, const ContainerOutput::Fill& fill,
                           const ExecutionContext& context = {}) {
      ZipOutput output(path, "", images);
      output.add_lazily({"1.png", "2.txt", "3.png"}, {10, 3 << 20, last_size}, fill);
      output.finish(context, {});
    };
    const auto sound = [](std::size_t i, Bytes& data) {
      data.assign(i == 1 ? 3 << 20 : 10, static_cast<std::uint8_t>(i));
    };
    EXPECT_THROW(write(10,
                       [&](std::size_t i, Bytes& data) {
                         if (i == 2) throw InputError("stop");
                         sound(i, data);
                       }),
                 InputError);
    EXPECT_THROW(write(11, sound), Error) << "not the promised size";
    std::atomic<bool> cancel{false};
    ExecutionContext context;
    context.cancel = &cancel;
    context.threads = 1;
    EXPECT_THROW(write(
                     10,
                     [&](std::size_t i, Bytes& data) {
                       cancel = true;
                       sound(i, data);
                     },
                     context),
                 Cancelled);
    ExecutionContext angry;
    angry.progress = [](std::string_view, double) { throw std::runtime_error("no"); };
    EXPECT_THROW(write(10, sound, angry), std::runtime_error);
    try {
      const test::FileSizeLimit limit(1 << 20);
      write(10, sound);
      ADD_FAILURE() << "written in spite of the limit";
    } catch (const DeviceError& error) {
      EXPECT_THAT(error.what(), HasSubstr(path + ": can't be written: File too large"));
    }
    EXPECT_EQ(test::read_file(path), before);
    EXPECT_EQ(folder.count(), 1);
  }
  EXPECT_THROW(ZipOutput(folder / "none/a.zip"), DeviceError);
  EXPECT_THROW(ZipOutput{folder.path()}, DeviceError);
}

}  // namespace
}  // namespace slicecorr
