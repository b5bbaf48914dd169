// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

#include <fcntl.h>

#include <atomic>

#include "base/run_length.hpp"
#include "file_size_limit.hpp"
#include "stack/blob_store.hpp"
#include "stack_fixture.hpp"

namespace slicecorr {
namespace {

using test::Bytes;
using test::FileSizeLimit;
using test::TemporaryFolder;

Bytes code_of(const Bytes& data) {
  Bytes code;
  detail::run_length_encode(data.data(), data.size(), code);
  return code;
}

TEST(RunLength, RoundTripsRunsOfAllLengths) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 3000; ++trial) {
    Bytes data;
    const auto most = 1 + random() % (trial % 2 == 0 ? 20 : 300);
    const auto values = 1 + random() % 256;
    const auto runs = random() % 30;
    for (unsigned r = 0; r < runs; ++r) {
      const auto value = random() % 3 == 0 ? 255 * (random() % 2) : random() % values;
      data.insert(data.end(), 1 + random() % most, static_cast<std::uint8_t>(value));
    }
    Bytes code{42};
    detail::run_length_encode(data.data(), data.size(), code);
    ASSERT_EQ(code[0], 42);
    ASSERT_LE(code.size() - 1, data.size() + data.size() / 64 + 2);
    // Nothing is written beyond what was asked for.
    Bytes decoded(data.size() + 64, 7);
    const std::uint8_t* const end = code.data() + code.size();
    ASSERT_EQ(detail::run_length_decode(code.data() + 1, end, decoded.data(), data.size()), end);
    ASSERT_EQ(std::ranges::count(Bytes(decoded.end() - 64, decoded.end()), 7), 64);
    decoded.resize(data.size());
    ASSERT_EQ(decoded, data);

    std::vector<detail::NonZero> nonzero;
    ASSERT_EQ(detail::run_length_nonzero(code.data() + 1, end, data.size(), nonzero), end);
    Bytes rebuilt(data.size(), 0);
    std::uint32_t next = 0;
    for (const detail::NonZero& v : nonzero) {
      ASSERT_GE(v.at, next);
      ASSERT_NE(v.value, 0);
      next = v.at + 1;
      rebuilt[v.at] = v.value;
    }
    ASSERT_EQ(rebuilt, data);

    const std::size_t one = random() % (data.size() + 1), other = random() % (data.size() + 1);
    std::vector<detail::NonZero> some;
    ASSERT_EQ(detail::run_length_nonzero(code.data() + 1, end, data.size(),
                                         {std::min(one, other), std::max(one, other)}, some),
              end);
    std::size_t told = 0;
    for (const detail::NonZero& v : nonzero) {
      if (v.at < std::min(one, other) || v.at >= std::max(one, other)) continue;
      ASSERT_LT(told, some.size());
      ASSERT_EQ(some[told].at, v.at);
      ASSERT_EQ(some[told++].value, v.value);
    }
    ASSERT_EQ(told, some.size());
  }
}

TEST(RunLength, IsShortForRunsAndNotLongForNoise) {
  EXPECT_LE(code_of(Bytes(1 << 24, 0)).size(), 6u);
  EXPECT_LE(code_of(Bytes(1 << 24, 255)).size(), 6u);
  EXPECT_LE(code_of(Bytes(1 << 24, 9)).size(), 7u);
  EXPECT_TRUE(code_of({}).empty());
  std::mt19937 random(2);
  Bytes noise(1 << 20);
  for (auto& byte : noise) byte = static_cast<std::uint8_t>(random() % 2 == 0 ? 0 : random());
  EXPECT_LE(code_of(noise).size(), noise.size() + noise.size() / 50);
}

TEST(RunLength, RefusesDamagedCode) {
  std::mt19937 random(3);
  for (int trial = 0; trial < 20000; ++trial) {
    Bytes code(random() % 20);
    for (auto& byte : code) byte = static_cast<std::uint8_t>(random());
    Bytes data(1 + random() % 200);
    try {
      const auto* const end = detail::run_length_decode(code.data(), code.data() + code.size(),
                                                        data.data(), data.size());
      EXPECT_LE(end, code.data() + code.size());
    } catch (const InputError&) {
    }
  }
  const Bytes code = code_of(Bytes(100, 3));
  Bytes data(101);
  const std::uint8_t* const end = code.data() + code.size();
  EXPECT_THROW(detail::run_length_decode(code.data(), end, data.data(), 99), InputError);
  EXPECT_THROW(detail::run_length_decode(code.data(), end, data.data(), 101), InputError);
  EXPECT_THROW(detail::run_length_decode(code.data(), end - 1, data.data(), 100), InputError);
}

TEST(BlobStore, KeepsPiecesInMemoryAndBeyond) {
  for (const std::size_t budget :
       {std::size_t{0}, std::size_t{1000}, std::size_t{3} << 20, std::size_t{1} << 30}) {
    const TemporaryFolder folder;
    std::atomic<int> notices{0};
    ExecutionContext context;
    context.threads = 4;
    context.notice = [&](const std::string& text) {
      ++notices;
      EXPECT_NE(text.find(folder.path()), std::string::npos) << text;
    };
    BlobStore store(folder.path(), budget, context);
    std::vector<BlobStore::Blob> blobs(400);
    const auto contents = [](std::size_t i) {
      std::mt19937 random(static_cast<unsigned>(i));
      Bytes data(random() % 30000);
      for (auto& byte : data) byte = static_cast<std::uint8_t>(random());
      return data;
    };
    std::size_t sum = 0;
    for (std::size_t i = 0; i < blobs.size(); ++i) sum += contents(i).size();
    parallel_for(context, "put", blobs.size(), [&](std::size_t i) {
      const Bytes data = contents(i);
      blobs[i] = store.put(data.data(), data.size());
    });
    parallel_for(context, "get", blobs.size(), [&](std::size_t i) {
      Bytes data{1, 2};
      store.get(blobs[i], data);
      Bytes expected{1, 2};
      const Bytes rest = contents(i);
      expected.insert(expected.end(), rest.begin(), rest.end());
      EXPECT_EQ(data, expected);
    });
    EXPECT_EQ(notices, budget < sum ? 1 : 0);
    EXPECT_EQ(store.scratch_bytes() > 0, budget < sum);
    EXPECT_LE(store.scratch_bytes(), sum);
    EXPECT_GE(store.scratch_bytes() + budget, sum);
    EXPECT_EQ(folder.count(), 0) << "the scratch file has a name";
  }
}

TEST(BlobStore, TakesRoomAgainThatWasGivenBack) {
  const TemporaryFolder folder;
  for (const std::size_t budget : {std::size_t{0}, std::size_t{100000}}) {
    BlobStore store(folder.path(), budget, {});
    std::mt19937 random(7);
    std::vector<std::pair<BlobStore::Blob, Bytes>> held;
    std::size_t now = 0, most = 0;
    for (int round = 0; round < 4000; ++round) {
      if (held.size() > 40 || (!held.empty() && random() % 3 == 0)) {
        const std::size_t k = random() % held.size();
        now -= held[k].second.size();
        store.drop(held[k].first);
        held.erase(held.begin() + static_cast<std::ptrdiff_t>(k));
        continue;
      }
      const Bytes data(random() % 9000, static_cast<std::uint8_t>(random()));
      held.emplace_back(store.put(data.data(), data.size()), data);
      most = std::max(most, now += data.size());
    }
    for (const auto& [blob, data] : held) {
      Bytes out;
      store.get(blob, out);
      ASSERT_EQ(out, data);
    }
    // Some 18 MB were put. Best fit of blobs of all sizes leaves at most as much free as is held.
    EXPECT_LE(store.scratch_bytes(), 2 * most);
  }
}

TEST(BlobStore, ReportsAMissingFolder) {
  BlobStore store("/nowhere/at all", 10, {});
  const Bytes data(11);
  EXPECT_NO_THROW(store.put(data.data(), 10));
  try {
    store.put(data.data(), 11);
    FAIL() << "nothing thrown";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/at all"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("No such file"), std::string::npos);
  }
}

TEST(BlobStore, ReportsAFullDisk) {
  const TemporaryFolder folder;
  BlobStore store(folder.path(), 0, {});
  const Bytes data(6000);
  const FileSizeLimit limit(10000);
  store.put(data.data(), data.size());
  EXPECT_THROW(store.put(data.data(), data.size()), DeviceError);
}

TEST(StackWriter, LeavesNothingOnAFullDisk) {
  const TemporaryFolder folder;
  const std::string path = folder / "a.uvj";
  test::write_file(path, {1, 2, 3});
  const auto images = test::random_images(200, 100, 30, 5);
  {
    const FileSizeLimit limit(20000);
    EXPECT_THROW(test::write_stack(path, images, test::info_of(images.grid)), DeviceError);
  }
  EXPECT_EQ(folder.count(), 1);
  EXPECT_EQ(test::read_file(path), (Bytes{1, 2, 3})) << "the old file was touched";
}

}  // namespace
}  // namespace slicecorr
