// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// What is not changed in a binary print file stays to the byte, also where files are odd: most of these were
// found by the fuzzers (tests/fuzz).
#include <gmock/gmock.h>

#include "print_file_fixture.hpp"
#include "slicecorr/pipeline.hpp"

namespace slicecorr {
namespace {

using namespace test;
using testing::HasSubstr;

class KeptPrintFiles : public testing::Test {
 protected:
  std::string write(const SmallFile& file) {
    write_file(folder_ / file.name, file.bytes);
    return folder_ / file.name;
  }
  StackReader reader(const std::string& path) { return {path, folder_.path()}; }
  Bytes rewritten(const SmallFile& file) {
    const std::string path = write(file);
    StackFile out(folder_ / ("out_" + file.name));
    out.keep_from = path;
    convert_stack(reader(path), out, {});
    return read_file(out.path);
  }
  /// The file with other images, as many as there are.
  SmallFile with_images(const SmallFile& file, const std::vector<Bytes>& slices) {
    const std::string path = write(file);
    const StackReader r = reader(path);
    SmallFile other = file;
    other.name = "other_" + file.name;
    other.slices = slices;
    StackFile out(folder_ / other.name);
    out.keep_from = path;
    StackInfo info = r.info();
    Images images{r.grid(), slices};
    images.grid.layers = info.grid.layers = info.target_layers = static_cast<int>(slices.size());
    write_stack(out, images, info);
    other.bytes = read_file(out.path);
    return other;
  }
  TemporaryFolder folder_;
};

std::uint32_t u32(const Bytes& bytes, std::size_t at) {
  return bytes.at(at) | std::uint32_t{bytes.at(at + 1)} << 8 |
         std::uint32_t{bytes.at(at + 2)} << 16 | std::uint32_t{bytes.at(at + 3)} << 24;
}
void set_u32(Bytes& bytes, std::size_t at, std::uint32_t value) {
  for (int i = 0; i < 4; ++i) bytes.at(at++) = static_cast<std::uint8_t>(value >> (8 * i));
}

SmallFile small_ctb() { return small_new("ctb", *detail::ctb_code(kFileWidth, kFileHeight, 0)); }
constexpr std::size_t kCtbRecord = 0x24, kCtbHead = 0x54;
std::size_t ctb_record(const Bytes& bytes, std::size_t layer) {
  return u32(bytes, 0x40) + layer * kCtbRecord;
}
std::size_t ctb_head(const Bytes& bytes, std::size_t layer) {
  return u32(bytes, ctb_record(bytes, layer) + 0x0c) - kCtbHead;
}

constexpr std::size_t kWorkshopRecord = 0x20;
std::size_t workshop_record(const Bytes& bytes, std::size_t layer) {
  return u32(bytes, 0x24) + 0x14 + layer * kWorkshopRecord;
}

/// Layers 1 and 2 are alike, and the second one's record says that it lies where the first does.
SmallFile sharing(SmallFile file, std::size_t (*record)(const Bytes&, std::size_t),
                  std::size_t offset, std::size_t size) {
  for (const std::size_t at : {offset, size}) {
    set_u32(file.bytes, record(file.bytes, 2) + at, u32(file.bytes, record(file.bytes, 1) + at));
  }
  file.slices[2] = file.slices[1];
  return file;
}

TEST_F(KeptPrintFiles, OfARecordAndItsCopyEachKeepsWhatNobodyKnows) {
  SmallFile file = small_ctb();
  file.bytes[ctb_record(file.bytes, 2) + 0x0a] = 0x31;
  file.bytes[ctb_head(file.bytes, 1) + 0x1e] = 0x32;
  EXPECT_EQ(rewritten(file), file.bytes);
  std::vector<Bytes> slices = file.slices;
  for (Bytes& slice : slices) slice[45] = slice[45] > 0 ? 0 : 255;
  const SmallFile other = with_images(file, slices);
  EXPECT_EQ(other.bytes[ctb_record(other.bytes, 2) + 0x0a], 0x31);
  EXPECT_EQ(other.bytes[ctb_head(other.bytes, 2) + 0x0a], 0);
  EXPECT_EQ(other.bytes[ctb_head(other.bytes, 1) + 0x1e], 0x32);
  EXPECT_EQ(read_images(reader(write(other))), slices);
}

TEST_F(KeptPrintFiles, SharedLayersStaySharedUntilTheyDiffer) {
  const SmallFile files[] = {
      sharing(small_ctb(), ctb_record, 0x0c, 0x10),
      sharing(small_workshop(false), workshop_record, 0, 4),
      sharing(small_workshop(true), workshop_record, 0, 4),
  };
  for (const SmallFile& file : files) {
    SCOPED_TRACE(file.name);
    EXPECT_EQ(read_images(reader(write(file))), file.slices);
    EXPECT_EQ(rewritten(file), file.bytes);
    // One of them changes, then both alike.
    std::vector<Bytes> slices = file.slices;
    slices[2][45] = slices[2][45] > 0 ? 0 : 255;
    const SmallFile apart = with_images(file, slices);
    EXPECT_EQ(read_images(reader(write(apart))), slices);
    EXPECT_EQ(reader(write(apart)).info().layer_exposure_s,
              reader(write(file)).info().layer_exposure_s);
    slices[1] = slices[2];
    const SmallFile alike = with_images(file, slices);
    EXPECT_EQ(read_images(reader(write(alike))), slices);
    EXPECT_LT(alike.bytes.size(), apart.bytes.size());
    // A layer is added behind them.
    slices.push_back(slices[0]);
    EXPECT_EQ(read_images(reader(write(with_images(file, slices)))), slices);
  }
}

TEST_F(KeptPrintFiles, ACountOfLitPixelsIsOnlyMadeForWhatChanges) {
  SmallFile file = small_workshop(false);
  constexpr std::size_t lit = 0x18;
  set_u32(file.bytes, workshop_record(file.bytes, 1) + lit, 12345);
  EXPECT_EQ(rewritten(file), file.bytes);
  std::vector<Bytes> slices = file.slices;
  slices[2].assign(slices[2].size(), 255);
  Bytes other = with_images(file, slices).bytes;
  EXPECT_EQ(u32(other, workshop_record(other, 1) + lit), 12345u);
  EXPECT_EQ(u32(other, workshop_record(other, 2) + lit), slices[2].size());
  slices[1].assign(slices[1].size(), 0);
  other = with_images(file, slices).bytes;
  EXPECT_EQ(u32(other, workshop_record(other, 1) + lit), 0u);
}

TEST_F(KeptPrintFiles, ATableMayStandBehindTheLayers) {
  SmallFile file = small_workshop(false);
  const std::size_t table = u32(file.bytes, 0x24);
  const auto from = file.bytes.begin() + static_cast<std::ptrdiff_t>(table);
  const Bytes copy(from, from + 0x14 + kFileLayers * kWorkshopRecord);
  set_u32(file.bytes, 0x24, static_cast<std::uint32_t>(file.bytes.size()));
  file.bytes.insert(file.bytes.end(), copy.begin(), copy.end());
  EXPECT_EQ(rewritten(file), file.bytes);
  std::vector<Bytes> slices = file.slices;
  slices.push_back(slices[1]);
  slices.push_back(slices[2]);
  EXPECT_EQ(read_images(reader(write(with_images(file, slices)))), slices);
}

TEST_F(KeptPrintFiles, AnOffsetIntoATableGoesWhereItWent) {
  constexpr std::size_t software = 0x18;  // which nobody reads
  SmallFile file = small_workshop(false);
  const std::uint32_t inside = u32(file.bytes, 0x14) + 0x27;
  set_u32(file.bytes, software, inside);
  EXPECT_EQ(rewritten(file), file.bytes);
  std::vector<Bytes> slices = file.slices;
  slices[0].assign(slices[0].size(), 255);
  EXPECT_EQ(u32(with_images(file, slices).bytes, software), inside);
}

TEST_F(KeptPrintFiles, ALayerThatLiesOnSomethingElseIsRefused) {
  SmallFile file = small_workshop(false);
  const std::uint32_t header = u32(file.bytes, 0x14);
  set_u32(file.bytes, workshop_record(file.bytes, 1), header);
  for (const std::uint32_t bytes : {0x60u, 0x64u, 0x54u}) {
    set_u32(file.bytes, workshop_record(file.bytes, 1) + 4, bytes);
    const std::string path = write(file);
    try {
      reader(path);
      ADD_FAILURE() << "read with " << bytes;
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr(path));
      EXPECT_THAT(e.what(), HasSubstr("overlaps"));
    }
  }
}

}  // namespace
}  // namespace slicecorr
