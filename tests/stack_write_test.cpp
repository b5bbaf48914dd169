// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <atomic>

#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Images;
using test::TemporaryFolder;

TEST(StackWriting, CancellationLeavesNothing) {
  const TemporaryFolder folder;
  const Images images = test::random_images(300, 200, 60, 2);
  for (const std::string stage : {"encode", "write"}) {
    std::atomic<bool> cancel{false};
    ExecutionContext context;
    context.cancel = &cancel;
    context.progress = [&](std::string_view s, double fraction) {
      if (s == stage && fraction >= (stage == "write" ? 0.3 : 0)) cancel = true;
    };
    EXPECT_THROW(test::write_stack(folder / "a.uvj", images, test::info_of(images.grid), context),
                 Cancelled);
    EXPECT_EQ(folder.count(), 0) << stage;
  }
  test::write_stack(folder / "a.uvj", images, test::info_of(images.grid));
  std::atomic<bool> cancel{true};
  ExecutionContext context;
  context.cancel = &cancel;
  EXPECT_THROW(StackReader(folder / "a.uvj", folder.path(), context), Cancelled);
}

TEST(StackWriting, ErrorsOfCallbacksLeaveNothing) {
  const TemporaryFolder folder;
  const Images images = test::random_images(30, 20, 60, 2);
  ExecutionContext context;
  context.progress = [&](std::string_view stage, double fraction) {
    if (stage == "write" && fraction > 0.4) throw InputError("from the callback");
  };
  EXPECT_THROW(test::write_stack(folder / "a.uvj", images, test::info_of(images.grid), context),
               InputError);
  { const StackWriter unfinished(folder / "b.uvj", images.grid, {}); }
  EXPECT_EQ(folder.count(), 0);
}

TEST(StackWriting, ReportsWhereItCanNotWrite) {
  const TemporaryFolder folder;
  const Grid grid{10, 10, 2, 50, 50, 50};
  const auto refused = [&](const std::string& path) {
    try {
      StackFile file(path);
      file.format = "uvj";
      const StackWriter writer(file, grid, {});
      ADD_FAILURE() << path << " was accepted";
    } catch (const DeviceError& error) {
      EXPECT_EQ(std::string(error.what()).rfind(path, 0), 0u) << error.what();
    }
  };
  refused(folder / "missing/a.uvj");
  refused(folder.path());
  refused(folder / "");
  refused("/dev/null");
  refused("/proc/a.uvj");
  test::write_file(folder / "file", {1});
  refused(folder / "file/a.uvj");
  // The folder goes away between the beginning and the end.
  std::filesystem::create_directory(folder / "sub");
  StackWriter writer(folder / "sub/a.uvj", grid, {});
  std::filesystem::remove(folder / "sub");
  EXPECT_THROW(writer.finish(test::info_of(grid), {}), DeviceError);
}

TEST(StackWriting, ReplacesAFileAndTakesLongNames) {
  const TemporaryFolder folder;
  const Images images = test::random_images(30, 20, 2, 2);
  for (const std::string& path : {folder / "a.uvj", folder / (std::string(251, 'x') + ".uvj")}) {
    test::write_file(path, {1, 2, 3});
    test::write_stack(path, images, test::info_of(images.grid));
    EXPECT_EQ(test::read_images(StackReader(path, folder.path())), images.slices);
  }
  EXPECT_EQ(folder.count(), 2);
}

}  // namespace
}  // namespace slicecorr
