// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

// Writes what the fuzzers begin with, small files of each kind: fuzz-seeds FOLDER.
#include <fmt/format.h>
#include <zlib.h>

#include <filesystem>

#include "archive_texts.hpp"
#include "job_entries.hpp"
#include "newer_print_file_fixture.hpp"
#include "slicecorr/tomo/npy.hpp"
#include "stack/png/png.hpp"
#include "stack/recording_entry.hpp"

namespace {

namespace fs = std::filesystem;
using namespace slicecorr;
using test::Bytes, test::to_bytes;

void write(const fs::path& path, const Bytes& bytes) {
  fs::create_directories(path.parent_path());
  test::write_file(path.string(), bytes);
}

/// Copies the files below a folder of the project that end so, but for large ones.
void copy(const std::string& from, const std::string& ending, const fs::path& folder) {
  for (const auto& file : fs::recursive_directory_iterator(fs::path(SLICECORR_SOURCE_DIR) / from)) {
    if (!file.is_regular_file() || file.path().extension() != ending) continue;
    if (file.file_size() <= 8192)
      write(folder / file.path().filename(), test::read_file(file.path()));
  }
}

/// A tetrahedron, in each format, and what else a format can say.
void write_meshes(const fs::path& folder) {
  for (const std::string kind : {"stl", "obj", "ply"}) {
    copy("tests/data/meshes", "." + kind, folder / kind);
  }
  test::FileMaker binary;
  binary.zeros(80).u32(4);
  const double corners[4][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const int faces[4][3] = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}};
  std::string ascii = "solid a\n";
  for (const auto& face : faces) {
    binary.zeros(12);
    ascii += "facet normal 0 0 0\nouter loop\n";
    for (const int v : face) {
      for (const double x : corners[v]) binary.f32(x);
      ascii += fmt::format("vertex {} {} {}\n", corners[v][0], corners[v][1], corners[v][2]);
    }
    binary.zeros(2);
    ascii += "endloop\nendfacet\n";
  }
  write(folder / "stl/binary", binary.bytes);
  write(folder / "stl/ascii", to_bytes(ascii + "endsolid a\n"));
  const std::string points = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n";
  const std::string lists = "3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n";
  write(folder / "off/plain", to_bytes("OFF\n4 4 6\n" + points + lists));
  write(
      folder / "off/colours",
      to_bytes("COFF # a comment\n4 1 0\n0 0 0 9 9 9 1\n1 0 0 9 9 9 1\n1 1 0 9 9 9 1\n0 1 0 9 9 9 "
               "1\n4 0 1 2 3 255 0 0\n"));
  write(folder / "obj/plain",
        to_bytes("# a comment\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 0 0 1\nf 1 3 2\nf 1//1 2//1 "
                 "4//1\nf -4 -1 -2 \\\n -3\n"));
  const std::string head =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\n"
      "element face 4\nproperty list uchar int vertex_indices\nelement edge 1\nproperty list int "
      "double weights\nend_header\n";
  write(folder / "ply/ascii",
        to_bytes("ply\nformat ascii 1.0\ncomment c\n" + head +
                 "0 0 0 1\n1 0 0 1\n0 1 0 1\n0 0 1 1\n" + lists + "2 0.5 1\n"));
  for (const bool big : {false, true}) {
    test::FileMaker m(big);
    m.text(fmt::format("ply\nformat binary_{}_endian 1.0\n", big ? "big" : "little") + head);
    for (const auto& p : corners) m.f32(p[0]).f32(p[1]).f32(p[2]).u8(1);
    for (const auto& face : faces) {
      m.u8(3);
      for (const int v : face) m.u32(static_cast<std::uint32_t>(v));
    }
    m.u32(1).zeros(8);
    write(folder / (big ? "ply/big" : "ply/little"), m.bytes);
  }
  const std::string object =
      R"(<object id="1" type="model"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/></vertices><triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="0" v2="3" v3="2"/><triangle v1="1" v2="2" v3="3"/></triangles></mesh></object>)";
  const std::string start =
      R"(<?xml version="1.0" encoding="UTF-8"?><model unit="inch" xml:lang="en-US" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>)";
  write(folder / "3mf/plain",
        to_bytes(start + object + R"(</resources><build><item objectid="1"/></build></model>)"));
  write(
      folder / "3mf/beams",
      to_bytes(
          R"(<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02" xmlns:c="http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07" requiredextensions="b c"><resources><object id="1"><mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/></vertices><triangles/><b:beamlattice radius=".1" minlength="0.01" cap="hemisphere" c:ballmode="mixed" c:ballradius=".3"><b:beams><b:beam v1="0" v2="1"/><b:beam v1="0" v2="2" r1=".2" r2=".1" cap1="butt" cap2="sphere"/></b:beams><c:balls><c:ball vindex="2"/></c:balls></b:beamlattice></mesh></object></resources><build><item objectid="1"/></build></model>)"));
  write(
      folder / "3mf/slices",
      to_bytes(
          R"(<model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" xmlns:s="http://schemas.microsoft.com/3dmanufacturing/slice/2015/07" requiredextensions="s"><resources><s:slicestack id="2" zbottom="1"><s:slice ztop="2"><s:vertices><s:vertex x="0" y="0"/><s:vertex x="1" y="0"/><s:vertex x="0" y="1"/></s:vertices><s:polygon startv="0"><s:segment v2="1"/><s:segment v2="2"/><s:segment v2="0"/></s:polygon></s:slice><s:slice ztop="3"/></s:slicestack><object id="1" s:slicestackid="2" s:meshresolution="lowres"><mesh><vertices/></mesh></object></resources><build><item objectid="1"/></build></model>)"));
  write(
      folder / "3mf/components",
      to_bytes(
          start + object +
          R"(<object id="2" type="model"><components><component objectid="1" transform="2 0 0 0 2 0 0 0 2 5 0 0"/></components></object></resources><build><item objectid="2" transform="1 0 0 0 1 0 0 0 1 0 0 9"/><item objectid="1"/></build></model>)"));
}

/// All kinds of colour, depth and filter, plain and interlaced, packed and as they are.
void write_pngs(const fs::path& folder) {
  const struct {
    const char* name;
    int colour, depth, interlaced, level;
  } kinds[] = {
      {"grey1", 0, 1, 0, 0},       {"grey2", 0, 2, 0, 0},      {"grey8", 0, 8, 0, 0},
      {"grey8packed", 0, 8, 0, 9}, {"grey16", 0, 16, 0, 0},    {"grey8interlaced", 0, 8, 1, 0},
      {"rgb8", 2, 8, 0, 0},        {"rgb16", 2, 16, 0, 0},     {"palette4", 3, 4, 0, 0},
      {"palette8", 3, 8, 0, 0},    {"greyalpha8", 4, 8, 0, 0}, {"greyalpha16", 4, 16, 0, 0},
      {"rgba8", 6, 8, 0, 0},       {"rgba16", 6, 16, 1, 0},    {"rgba8packed", 6, 8, 0, 6}};
  constexpr int width = 9, height = 7, channels_of[] = {1, 0, 3, 1, 2, 0, 4};
  for (const auto& kind : kinds) {
    Bytes png;
    detail::PixelCode code;
    code.colour = static_cast<std::uint8_t>(kind.colour);
    code.bit_depth = static_cast<std::uint8_t>(kind.depth);
    detail::append_png_header(width, height, code, png);
    const auto chunk = [&](const char* type, const Bytes& bytes) {
      const std::size_t at = detail::begin_chunk(type, png);
      png.insert(png.end(), bytes.begin(), bytes.end());
      detail::end_chunk(at, png);
    };
    if (kind.interlaced != 0) {
      const std::size_t header_at = 8;
      Bytes header(png.begin() + header_at + 8, png.begin() + header_at + 21);
      header[12] = 1;
      png.resize(header_at);
      chunk("IHDR", header);
    }
    if (kind.colour == 3) {
      Bytes palette;
      for (int i = 0; i < 3 * (1 << kind.depth); ++i)
        palette.push_back(static_cast<std::uint8_t>(i));
      chunk("PLTE", palette);
      chunk("tRNS", {0, 128});
    }
    // The rows of a pass of an interlaced image, or of the image.
    Bytes rows;
    const auto add_rows = [&](int w, int h) {
      if (w == 0) return;
      for (int y = 0; y < h; ++y) {
        rows.push_back(static_cast<std::uint8_t>(y % 5));
        const int bytes = (w * channels_of[kind.colour] * kind.depth + 7) / 8;
        for (int i = 0; i < bytes; ++i) rows.push_back(static_cast<std::uint8_t>(17 * i + y));
      }
    };
    if (kind.interlaced == 0) {
      add_rows(width, height);
    } else {
      constexpr int pass[7][4] = {{0, 0, 8, 8}, {4, 0, 8, 8}, {0, 4, 4, 8}, {2, 0, 4, 4},
                                  {0, 2, 2, 4}, {1, 0, 2, 2}, {0, 1, 1, 2}};
      for (const auto& [x, y, dx, dy] : pass) {
        add_rows((width - x + dx - 1) / dx, (height - y + dy - 1) / dy);
      }
    }
    Bytes packed(compressBound(rows.size()) + 64);
    uLongf size = packed.size();
    compress2(packed.data(), &size, rows.data(), rows.size(), kind.level);
    packed.resize(size);
    const auto middle = packed.begin() + static_cast<std::ptrdiff_t>(size / 2);
    chunk("IDAT", {packed.begin(), middle});
    chunk("IDAT", {middle, packed.end()});
    detail::append_png_iend(png);
    write(folder / kind.name, png);
  }
}

/// One text for each number that a fuzzer takes from the first byte.
void write_numbered(const fs::path& folder, const std::vector<std::string>& texts) {
  for (std::size_t i = 0; i < texts.size(); ++i) {
    Bytes bytes{static_cast<std::uint8_t>(i)};
    bytes.insert(bytes.end(), texts[i].begin(), texts[i].end());
    write(folder / std::to_string(i), bytes);
  }
}

void write_jobs(const fs::path& folder) {
  for (const auto& [kind, entries] :
       {std::pair{"frames", fuzz::frames_entries()}, std::pair{"beams", fuzz::beams_entries()}}) {
    std::vector<std::string> texts;
    for (const auto& e : entries) texts.push_back(test::to_text(e.second));
    write_numbered(folder / kind, texts);
  }
  tomo::write_npy((folder / "npy/part").string(), tomo::Box<std::uint8_t>{2, 2, 2, Bytes(8, 255)});
  tomo::write_npy((folder / "npy/dose").string(),
                  tomo::Box<float>{1, 2, 2, std::vector<float>(4, 0.5F)});
  Recording recording;
  for (int n = 0; n < 2; ++n) {
    const Recording::Showing showing{n, 1.0, 2.0, 0, 0, 0, 1.0};
    recording.add_slice({&showing, 1});
  }
  write_numbered(folder / "recording", {"", detail::recording_csv(recording)});
  const std::string toml =
      "[defaults]\nprinter = \"p\"\nresin = \"r\"\nlayer_um = 50\n[[job]]\npart = \"a.stl\"\ncopies = 3\n"
      "ready_by = \"07:00\"\n[[job]]\nparts = [\"b.stl*2\", \"c.stl\"]\nlabels = [\"x\"]\nplan = true\n";
  const std::string json =
      R"({"defaults": {"printer": "p", "resin": "r", "layer_um": 50}, "jobs": [{"part": "a.stl", "speed_mm_h": 800, "rotate_deg": [0, 90, 0]}]})";
  write_numbered(
      folder / "jobs",
      {toml, "part,layer_um,speed_mm_h,copies\na.stl,50,800,2\n\"b,c.stl\",,900,\n", json});
  write_numbered(folder / "rest", {json, R"({"why": "x"})", "{}", R"({"priority": 3})",
                                   R"({"bridge": "x", "plate_is_empty": true})"});
}

/// What comes over the wires of a machine, and what a print leaves on the disk.
void write_bridge(const fs::path& folder) {
  const auto bytes = [](const std::string& text) { return to_bytes(text); };
  // A right answer to function code 23 with 13 registers, an exception, and a request to read.
  const std::string head("\0\1\0\0\0", 5);
  write(folder / "modbus-answer/registers", bytes(head + "\x1d\1\x17\x1a" + std::string(26, '\1')));
  write(folder / "modbus-answer/exception", bytes(head + std::string("\3\1\x97\4", 4)));
  write(folder / "modbus-request/read", bytes(head + std::string("\6\1\3\0\x64\0\x0d", 7)));
  write(folder / "modbus-request/write",
        bytes(head + std::string("\x0b\1\x10\0\0\0\2\4\0\1\0\2", 12)));
  test::FileMaker tick;
  tick.u32(0x57464353).u16(1).u16(3).zeros(40);
  write(folder / "wire/tick", tick.bytes);
  for (const char* word : {"status", "pause", "resume", "stop"}) {
    write(folder / "control" / word, bytes(word));
  }
  write_numbered(
      folder / "state",
      {"{\"time\":\"2026-01-02T03:04:05.678Z\",\"at_s\":1,\"what\":\"print begins\",\"detail\":\"a.uvj\",\"frame\":-"
       "1,\"stage_um\":0,\"facts\":{\"start_um\":1}}\n",
       "frame,planned_z_um,z_um\n0,1,2\n1,50,51\n", "{\"running\":true,\"phase\":\"printing\"}",
       "{\"fault\":\"heartbeat_lost\",\"detail\":\"x\",\"frame\":3,\"stage_um\":5}",
       "{\"version\":1,\"file\":\"a.sl1\",\"print_state\":\"begun\",\"sent_jobs\":[1,2]}"});
  write(folder / "sqlite/header", Bytes{18, 0, 0, 0, 9});
  write(folder / "sqlite/page", Bytes{0, 16, 0, 0, 255, 101, 0, 0, 0, 1});
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  const fs::path folder = argv[1];
  for (const test::SmallFile& file : test::small_binary_files()) {
    write(folder / file.format / file.name, file.bytes);
  }
  write_meshes(folder);
  fs::create_directories(folder / "npy");
  write_jobs(folder);
  write_bridge(folder);
  write_pngs(folder / "png");
  std::size_t number = 0;
  for (const fuzz::ArchiveText& text : fuzz::archive_texts()) {
    Bytes bytes{static_cast<std::uint8_t>(number)};
    const Bytes& own = text.entries[text.entry].second;
    bytes.insert(bytes.end(), own.begin(), own.end());
    write(folder / "archive" / std::to_string(number++), bytes);
  }
  copy("resins/db", ".toml", folder / "definition");
  copy("resins/printers", ".toml", folder / "definition");
  copy("resins/db", ".csv", folder / "measurements");
  write(folder / "measurements/dead-zones",
        to_bytes("# made up\nblue_mw_cm2,uv_mw_cm2,exposure_s,dead_zone_um,sigma_um\n"
                 "20,10,5,\"80\",2 # a remark\n20,15,5,120,2\n30,15,5,90,\n"));
  write(folder / "measurements/heights",
        to_bytes("\xef\xbb\xbfintensity_mw_cm2;exposure_s\r\n1;2\r\n"));
  number = 0;
  for (
      const char* request :
      {"GET /healthz HTTP/1.1\r\n\r\n", "HEAD / HTTP/1.1\r\n\r\n",
       "GET /api/v1/jobs?limit=5 HTTP/1.1\r\n\r\n",
       "GET /api/v1/events HTTP/1.1\r\nRange: bytes=0-1\r\n\r\n",
       "POST /api/v1/jobs HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 11\r\n\r\n{\"jobs\":[]}",
       "PUT /api/v1/parts/a.stl HTTP/1.1\r\nContent-Length: 5\r\n\r\nsolid"}) {
    write(folder / "server" / std::to_string(number++), to_bytes(request));
  }
  // A name of the service, and of a printer of it: a PTR with an SRV and a TXT behind it.
  const std::string service("\x0a_octoprint\x04_tcp\x05local\0", 23);
  const auto record = [](const std::string& name, char kind, const std::string& data) {
    return name + std::string("\0", 1) + kind + std::string("\x80\1\0\0\0\x0a\0", 7) +
           static_cast<char>(data.size()) + data;
  };
  const std::string ptr = record(service, 0x0c, std::string("\3abc\xc0\x0c", 6));
  write(folder / "mdns/0", to_bytes(std::string("\0\0\x84\0\0\0\0\1\0\0\0\0", 12) + ptr));
  write(folder / "mdns/1",
        to_bytes(std::string("\0\0\x84\0\0\0\0\1\0\0\0\2", 12) + ptr +
                 record("\xc0\x2d", 0x21, std::string("\0\0\0\0\x13\x88\1h\0", 9)) +
                 record("\xc0\x2d", 0x10, "\x09model=SL1\x0cvendor=Prusa")));
  return 0;
}
