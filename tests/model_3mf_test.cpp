// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// What of a 3MF prints: components, slicers' projects, beams, slices; and what is refused by its name.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <zip.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <numbers>
#include <random>
#include <sstream>

#include "meshes.hpp"
#include "real_files.hpp"
#include "slicecorr/error.hpp"
#include "slicecorr/mesh.hpp"
#include "slicecorr/slice.hpp"

namespace slicecorr::model_3mf_tests {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

using Parts = std::vector<std::pair<std::string, std::string>>;

const std::string kRelationHead =
    R"(<?xml version="1.0" encoding="UTF-8"?><Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">)";
const std::string kModelRelation =
    R"(<Relationship Target="/3D/3dmodel.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>)";
const std::string kBeamSpace =
    R"(xmlns:b="http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02" )";
const std::string kBallSpace =
    R"(xmlns:b2="http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07" )";
const std::string kSliceSpace =
    R"(xmlns:s="http://schemas.microsoft.com/3dmanufacturing/slice/2015/07" )";
const std::string kPathSpace =
    R"(xmlns:p="http://schemas.microsoft.com/3dmanufacturing/production/2015/06" )";
const std::string kMaterialSpace =
    R"(xmlns:m="http://schemas.microsoft.com/3dmanufacturing/material/2015/02" )";

std::string model(const std::string& attributes, const std::string& resources,
                  const std::string& build) {
  return R"(<?xml version="1.0" encoding="UTF-8"?><model xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02" )" +
         attributes + "><resources>" + resources + "</resources><build>" + build +
         "</build></model>";
}

std::string vertices(const TriangleMesh& mesh) {
  std::ostringstream out;
  out.precision(17);
  for (const Point3& p : mesh.vertices) {
    out << "<vertex x=\"" << p[0] << "\" y=\"" << p[1] << "\" z=\"" << p[2] << "\"/>";
  }
  return out.str();
}

std::string mesh_of(const TriangleMesh& mesh, const std::string& more = "") {
  std::ostringstream out;
  out << "<mesh><vertices>" << vertices(mesh) << "</vertices><triangles>";
  for (const auto& t : mesh.triangles) {
    out << "<triangle v1=\"" << t[0] << "\" v2=\"" << t[1] << "\" v3=\"" << t[2] << "\"/>";
  }
  out << "</triangles>" << more << "</mesh>";
  return out.str();
}

std::string object(int id, const std::string& content, const std::string& attributes = "") {
  return "<object id=\"" + std::to_string(id) + "\" " + attributes + ">" + content + "</object>";
}

std::string item(int id, const std::string& attributes = "") {
  return "<item objectid=\"" + std::to_string(id) + "\" " + attributes + "/>";
}

const TriangleMesh kCube = test::box({0, 0, 0}, {10, 10, 10});

class Model3mf : public testing::Test {
 protected:
  Model3mf() {
    char name[] = "/tmp/slicecorr-3mf-XXXXXX";
    folder_ = mkdtemp(name);
  }
  ~Model3mf() override { fs::remove_all(folder_); }

  std::string pack(const Parts& parts) const {
    const std::string path = (folder_ / "part.3mf").string();
    fs::remove(path);
    zip_t* const zip = zip_open(path.c_str(), ZIP_CREATE, nullptr);
    for (const auto& [part, text] : parts) {
      const auto index =
          zip_file_add(zip, part.c_str(), zip_source_buffer(zip, text.data(), text.size(), 0), 0);
      zip_set_file_compression(zip, static_cast<zip_uint64_t>(index), ZIP_CM_DEFLATE, 1);
    }
    zip_close(zip);
    return path;
  }
  std::string write(const std::string& text, const Parts& more = {}) const {
    Parts parts{{"_rels/.rels", kRelationHead + kModelRelation + "</Relationships>"},
                {"3D/3dmodel.model", text}};
    parts.insert(parts.end(), more.begin(), more.end());
    return pack(parts);
  }
  TriangleMesh read(const std::string& path) {
    notes_.clear();
    return read_mesh(path, {}, {}, &notes_);
  }
  TriangleMesh read(const std::string& text, const Parts& more) { return read(write(text, more)); }
  std::string refused(const std::string& path) const {
    try {
      read_mesh(path);
    } catch (const InputError& e) {
      EXPECT_THAT(e.what(), HasSubstr("part.3mf"));
      return e.what();
    }
    ADD_FAILURE() << "is read";
    return {};
  }
  std::string refused(const std::string& text, const Parts& more) const {
    return refused(write(text, more));
  }

  fs::path folder_;
  std::vector<std::string> notes_;
};

/// By slices of 0.05 mm and pixels of 0.05 mm.
double sliced_mm3(const TriangleMesh& mesh, double step_mm = 0.05) {
  const MeshReport r = inspect(mesh);
  // Sides of boxes lie on sides of pixels.
  const auto pixels = [&](std::size_t k) {
    return static_cast<int>(std::ceil((r.upper[k] - r.lower[k]) / step_mm - 1e-6)) + 2;
  };
  const Printer p = test::printer(pixels(0), pixels(1), step_mm * 1e3, step_mm * 1e3);
  const MeshSlices slices(mesh, p, test::layer_of(step_mm * 1e3));
  double sum = 0;
  slices.read_band({0, 0, p.width_px, p.height_px}, [&](int, const std::uint8_t* values) {
    for (int i = 0; values && i < p.width_px * p.height_px; ++i) sum += values[i];
  });
  return sum / 255 * step_mm * step_mm * step_mm;
}

// The right values of small inputs that went wrong elsewhere.
TEST_F(Model3mf, ReportedInputs) {
  const auto volume = [&](const std::string& name) {
    const std::string path = test::real_file("meshes/reported/" + name);
    EXPECT_TRUE(fs::exists(path)) << path;
    return sliced_mm3(read(path), 0.25) * 1e-3;
  };
  EXPECT_NEAR(volume("prusa_negative_volume.3mf"), 3.0, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 negative volume taken away from the part"));
  EXPECT_NEAR(volume("bambu_negative_part.3mf"), 3.0, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 negative volume taken away from the part"));
  EXPECT_NEAR(volume("prusa_support_blocker.3mf"), 4.0, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 support blocker left out: no part"));
  EXPECT_NEAR(volume("item_printable_0.3mf"), 1.0, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 item left out: switched off (not printable)"));
  EXPECT_NEAR(volume("type_support.3mf"), 1.0, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 object of the type 'support' left out: no solid"));
  EXPECT_NEAR(volume("slices_lowres_mesh.3mf"), 0.16, 1e-6);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("1 object made of the slices")));
  EXPECT_NEAR(volume("valid_composite.3mf"), 1.0, 1e-6);
  EXPECT_THAT(notes_, IsEmpty());
  EXPECT_NEAR(volume("valid_object_metadatagroup.3mf"), 1.0, 1e-6);
  for (const std::string name : {"ascii_list_uint", "int_coords", "list_uint_int",
                                 "list_ushort_int", "mixed_newline", "zyx"}) {
    EXPECT_NEAR(volume("ply_" + name + ".ply"), 0.072, 1e-6) << name;
  }
  EXPECT_NEAR(volume("obj_bom.obj"), 0.072, 1e-6);
  EXPECT_NEAR(volume("stl_ascii_bom.stl"), 0.072, 1e-6);
  try {
    read(test::real_file("meshes/reported/type_other.3mf"));
    ADD_FAILURE();
  } catch (const InputError& e) {
    EXPECT_THAT(e.what(), HasSubstr("'other', which 3MF does not allow"));
  }
}

// The consortium's own files.
TEST_F(Model3mf, WhatMustBeReadIsAndWhatMustNotIsRefused) {
  const std::vector<std::string> good = test::real_files("meshes/3mf/must-pass");
  const std::vector<std::string> wrong = test::real_files("meshes/3mf/must-fail");
  EXPECT_EQ(good.size(), 13u);
  EXPECT_EQ(wrong.size(), 38u);
  for (const std::string& path : good) EXPECT_GT(inspect(read(path)).volume, 0) << path;
  for (const std::string& path : wrong) {
    // Says nothing that the file 3.4.1c of those that must be read does not say, but for the name of a
    // metadata entry, which nobody has to know.
    if (path.find("3.4.1a") != path.npos) continue;
    EXPECT_THROW(read(path), InputError) << path;
  }
}

TEST_F(Model3mf, PropertiesAreNotGeometry) {
  const std::string properties =
      R"(<basematerials id="1"><base name="a" displaycolor="#FF0000"/></basematerials>)"
      R"(<m:texture2d id="2" path="/3D/t.png" contenttype="image/png"/>)"
      R"(<m:texture2dgroup id="3" texid="2"><m:tex2coord u="0" v="1"/></m:texture2dgroup>)"
      R"(<m:colorgroup id="4"><m:color color="#00FF0080"/></m:colorgroup>)"
      R"(<m:compositematerials id="5" matid="1" matindices="0"><m:composite values="1"/></m:compositematerials>)"
      R"(<m:multiproperties id="6" pids="5 4"><m:multi pindices="0 0"/></m:multiproperties>)"
      R"(<m:pbmetallicdisplayproperties id="7"><m:pbmetallic name="x" metallicness="1" roughness="0"/></m:pbmetallicdisplayproperties>)";
  const std::string cube = object(
      9, "<metadatagroup><metadata name=\"Title\">x</metadata></metadatagroup>" + mesh_of(kCube),
      R"(type="model" pid="6" pindex="0")");
  EXPECT_NEAR(inspect(read(model(kMaterialSpace, properties + cube, item(9)), {})).volume, 1000,
              1e-9);
  EXPECT_THAT(notes_, IsEmpty());
  const std::string text = model(kMaterialSpace, properties + cube, item(9));
  struct Wrong {
    const char *right, *wrong, *words;
  };
  for (const Wrong& w : {
           Wrong{"id=\"4\"", "id=\"3\"", "the id 3 belongs to another resource, too"},
           {"pid=\"6\"", "pid=\"8\"", "property group 8 is not there"},
           {"pid=\"6\"", "", "a pindex without a pid"},
           {"pids=\"5 4\"", "pids=\"5 1\"", "more than one group of materials"},
           {"#00FF0080", "green", "a colour 'green'"},
           {"image/png", "image/gif", "'image/gif'"},
           {"matid=\"1\"", "matid=\"4\"", "expected basematerials"},
       }) {
    SCOPED_TRACE(w.words);
    std::string other = text;
    const std::size_t at = other.find(w.right);
    ASSERT_NE(at, text.npos);
    EXPECT_THAT(refused(other.replace(at, std::strlen(w.right), w.wrong), {}), HasSubstr(w.words));
  }
}

TEST_F(Model3mf, ComponentsOfOtherParts) {
  const Parts parts{
      {"3D/Objects/a b.model",
       model(
           "",
           object(1, mesh_of(kCube)) +
               object(
                   2,
                   R"(<components><component objectid="1" transform="1 0 0 0 1 0 0 0 1 20 0 0"/></components>)"),
           "")}};
  const std::string main = model(
      kPathSpace + "requiredextensions=\"p\"",
      object(
          1,
          R"(<components><component objectid="2" p:path="/3D/Objects/A%20b.model"/><component objectid="1" p:path="/3D/Objects/a b.model" transform="-1 0 0 0 1 0 0 0 1 0 0 50"/></components>)"),
      item(1) +
          item(1, "p:path=\"/3D/Objects/a b.model\" transform=\"2 0 0 0 1 0 0 0 1 100 0 0\""));
  const MeshReport r = inspect(read(main, parts));
  EXPECT_EQ(r.bodies, 3u);
  EXPECT_NEAR(r.volume, 4000, 1e-9);
  EXPECT_EQ(r.lower, (Point3{-10, 0, 0}));
  EXPECT_EQ(r.upper, (Point3{120, 10, 60}));
  const auto with = [&](const std::string& path) {
    return refused(model(kPathSpace, "", "<item objectid=\"1\" p:path=\"" + path + "\"/>"), parts);
  };
  EXPECT_THAT(with("/3D/nothing.model"),
              HasSubstr("'/3D/nothing.model', which is not in the package"));
  EXPECT_THAT(with("/../../etc/passwd"), HasSubstr("leads out of the package"));
  EXPECT_THAT(with("/3D/Objects/../../../a"), HasSubstr("leads out of the package"));
  EXPECT_THAT(
      refused(model(kPathSpace, "", "<item objectid=\"7\" p:path=\"/3D/Objects/a b.model\"/>"),
              parts),
      HasSubstr("there is no object 7 in 3D/Objects/a b.model"));
  EXPECT_THAT(refused(main, {{"3D/Objects/a b.model",
                              model("unit=\"inch\"", object(1, mesh_of(kCube)), "")}}),
              HasSubstr("another unit"));
}

TEST_F(Model3mf, ComponentsWithoutAnEnd) {
  const auto part = [](int id, const std::string& components) {
    return object(id, "<components>" + components + "</components>");
  };
  EXPECT_THAT(refused(model("", part(1, R"(<component objectid="1"/>)"), item(1)), {}),
              HasSubstr("contain themselves"));
  EXPECT_THAT(refused(model("",
                            part(1, R"(<component objectid="2"/>)") +
                                part(2, R"(<component objectid="1"/>)"),
                            item(2)),
                      {}),
              HasSubstr("contain themselves"));
  // Round through another part.
  EXPECT_THAT(
      refused(
          model(kPathSpace, part(1, R"(<component objectid="2" p:path="/3D/b.model"/>)"), item(1)),
          {{"3D/b.model",
            model(kPathSpace, part(2, R"(<component objectid="1" p:path="/3D/3dmodel.model"/>)"),
                  "")}}),
      HasSubstr("contain themselves"));
  std::string chain = object(1, mesh_of(kCube));
  for (int id = 2; id < 80; ++id)
    chain += part(id, "<component objectid=\"" + std::to_string(id - 1) + "\"/>");
  EXPECT_NEAR(inspect(read(model("", chain, item(60)), {})).volume, 1000, 1e-9);
  EXPECT_THAT(refused(model("", chain, item(79)), {}), HasSubstr("without a sensible end"));
  // Objects may come in any order.
  EXPECT_NEAR(
      inspect(read(model("", part(1, R"(<component objectid="2"/>)") + object(2, mesh_of(kCube)),
                         item(1)),
                   {}))
          .volume,
      1000, 1e-9);
}

TEST_F(Model3mf, RequiredExtensionsAreReadOrRefused) {
  const std::string cube = object(1, mesh_of(kCube));
  for (const std::string space :
       {"http://schemas.microsoft.com/3dmanufacturing/volumetric/2022/01",
        "http://schemas.3mf.io/3dmanufacturing/displacement/2023/10",
        "http://schemas.3mf.io/3dmanufacturing/booleanoperations/2023/07",
        "http://schemas.microsoft.com/3dmanufacturing/securecontent/2019/04", "urn:anybody"}) {
    const std::string names = "xmlns:x=\"" + space + "\" ";
    const std::string why = refused(model(names + "requiredextensions=\"x\"", cube, item(1)), {});
    EXPECT_THAT(why, HasSubstr("requires the extension 'x' (" + space + "), which is not read"));
    // Not required: what stands there is left out, and said.
    EXPECT_NEAR(
        inspect(read(model(names, "<x:thing id=\"4\"><x:inner/></x:thing>" + cube, item(1)), {}))
            .volume,
        1000, 1e-9);
    ASSERT_EQ(notes_.size(), 1u);
    EXPECT_THAT(notes_[0], HasSubstr(space + " ('thing') are not read"));
    read(
        model(
            names +
                R"(xmlns:mc="http://schemas.openxmlformats.org/markup-compatibility/2006" mc:Ignorable="x")",
            "<x:thing/>" + cube, item(1, "x:a=\"1\"")),
        {});
    EXPECT_THAT(notes_, IsEmpty());
    read(model(names + "recommendedextensions=\"x\"", cube, item(1)), {});
    ASSERT_EQ(notes_.size(), 1u);
    EXPECT_THAT(notes_[0], HasSubstr("is recommended by the file, and not read"));
  }
  EXPECT_THAT(refused(model("requiredextensions=\"q\"", cube, item(1)), {}),
              HasSubstr("the prefix 'q' stands for no namespace"));
  read(model(kBeamSpace + kSliceSpace + kPathSpace + kMaterialSpace + kBallSpace +
                 "requiredextensions=\"b s p m b2\"",
             cube, item(1)),
       {});
  EXPECT_THAT(notes_, IsEmpty());
}

TEST_F(Model3mf, WhatIsNoModelIsRefusedInWords) {
  const std::string cube = object(1, mesh_of(kCube));
  const struct {
    std::string text, why;
  } wrong[] = {
      {"<model/>", "is no 3MF model"},
      {"", "no element found"},
      {model("", cube, item(1)) + "<model/>", "junk after document element"},
      {model("unit=\"parsec\"", cube, item(1)), "unknown unit 'parsec'"},
      {model("xml:space=\"preserve\"", cube, item(1)), "xml:space"},
      {model("", cube + cube, item(1)), "the id 1 belongs to another resource"},
      {model("", object(1, mesh_of(kCube), "type=\"solid\""), item(1)),
       "an object of the type 'solid'"},
      {model("", object(1, mesh_of(kCube), "type=\"other\""), item(1)),
       "'other', which 3MF does not allow"},
      {model("", object(1, ""), item(1)), "neither a mesh nor components"},
      {model("", object(1, mesh_of(kCube) + mesh_of(kCube)), item(1)), "'mesh' is there twice"},
      {model("", object(1, "<shape/>"), item(1)), "unknown element 'shape'"},
      {model("", cube, item(2)), "there is no object 2"},
      {model("", cube, item(1, "transform=\"1 0 0 0 1 0 0 0 1 0 0\"")),
       "a transform of 11 numbers"},
      {model("", cube, item(1, "transform=\"1 0 0 0 1 0 0 0 0 0 0 0\"")), "leaves no volume"},
      {model("", cube, item(1, "transform=\"1 0 0 0 1 0 0 0 x 0 0 0\"")), "found 'x'"},
      {model("", cube, "<item/>"), "lacks the attribute 'objectid'"},
      {model("", cube, ""), "holds no triangles"},
      {model("", cube, item(1, "printable=\"0\"")),
       "holds no triangles that print: 1 item left out: switched off (not printable)"},
      {model("", object(0, mesh_of(kCube)), item(1)), "a whole number from 1 expected for id"},
      {model("", object(1, "<mesh><vertices><vertex x=\"1\" y=\"2\"/></vertices></mesh>"), item(1)),
       "vertex 1 lacks one of the attributes"},
      {model(
           "",
           object(1, "<mesh><vertices>" + vertices(kCube) +
                         "</vertices><triangles><triangle v1=\"0\" v2=\"1\"/></triangles></mesh>"),
           item(1)),
       "triangle 1 lacks one of the attributes"},
      {model("", object(1, "<mesh><vertices a=\"1\">" + vertices(kCube) + "</vertices></mesh>"),
             item(1)),
       "the element 'vertices' has the attribute 'a'"},
  };
  for (const auto& [text, why] : wrong)
    EXPECT_THAT(refused(text, {}), HasSubstr(why)) << text.substr(0, 300);
  // Errors say part and line.
  std::string lines = model("", object(1, "\n\n<mesh>\n<oops/></mesh>"), item(1));
  EXPECT_THAT(refused(lines, {}), HasSubstr("3D/3dmodel.model, line 4: unknown element 'oops'"));
}

TEST_F(Model3mf, PackagesThatAreNone) {
  const std::string good = model("", object(1, mesh_of(kCube)), item(1));
  const auto relations = [&](const std::string& text) {
    return refused(pack(
        {{"_rels/.rels", kRelationHead + text + "</Relationships>"}, {"3D/3dmodel.model", good}}));
  };
  EXPECT_THAT(relations(""), HasSubstr("says no model to print"));
  EXPECT_THAT(relations(kModelRelation + kModelRelation), HasSubstr("more than one model"));
  EXPECT_THAT(
      relations(kModelRelation + R"(<Relationship Target="/a.png" Id="t" Type="thumbnail"/>)"),
      HasSubstr("'/a.png', which is not in the package"));
  EXPECT_THAT(
      relations(
          R"(<Relationship Target="http://x" Id="r" TargetMode="External" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>)"),
      HasSubstr("the model is not in the package"));
  EXPECT_THAT(relations("<Other/>"), HasSubstr("unknown element 'Other'"));
  EXPECT_THAT(refused(pack({{"3D/3dmodel.model", good}})), HasSubstr("says no model to print"));
  // Links that people follow are theirs; the model may have any name, in any case.
  EXPECT_NEAR(
      inspect(
          read(pack(
              {{"_rels/.rels",
                kRelationHead +
                    R"(<Relationship Target="Deep/MY.model" Id="r" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/><Relationship Target="http://x" Id="q" TargetMode="External" Type="link"/>)" +
                    "</Relationships>"},
               {"deep/my.MODEL", good}})))
          .volume,
      1000, 1e-9);
  EXPECT_THAT(refused(pack({{"_rels/.rels", kRelationHead + kModelRelation + "</Relationships>"},
                            {"3D/3dmodel.model", good},
                            {"3d/3DMODEL.model", good}})),
              HasSubstr("this part is there twice"));
}

TEST_F(Model3mf, DangerousTextsAreBounded) {
  const std::string cube = object(1, mesh_of(kCube));
  const std::string text = model("", cube, item(1));
  const std::string body = text.substr(text.find("<model"));
  // Entities of entities.
  std::string bomb = "<?xml version=\"1.0\"?><!DOCTYPE x [<!ENTITY a \"aaaaaaaaaa\">";
  for (char c = 'b'; c < 'k'; ++c) {
    bomb += std::string("<!ENTITY ") + c + " \"";
    for (int i = 0; i < 10; ++i) bomb += std::string("&") + static_cast<char>(c - 1) + ";";
    bomb += "\">";
  }
  EXPECT_THAT(refused(bomb + "]>" + body, {}), HasSubstr("declares a document type"));
  EXPECT_THAT(refused("<!DOCTYPE model SYSTEM \"file:///etc/passwd\">" + body, {}),
              HasSubstr("declares a document type"));
  EXPECT_THAT(refused(model("", cube, item(1) + "&x;"), {}), HasSubstr("undefined entity"));
  EXPECT_THAT(refused("<?xml version=\"1.0\" encoding=\"UTF-16\"?>" + body, {}),
              HasSubstr("not in UTF-8"));
  EXPECT_THAT(refused("<?xml version=\"1.0\" encoding=\"latin1\"?>" + body, {}),
              HasSubstr("not in UTF-8"));
  EXPECT_THAT(refused("\xff\xfe" + body, {}), HasSubstr("is not in UTF-8"));
  EXPECT_NEAR(inspect(read("\xef\xbb\xbf" + body, {})).volume, 1000, 1e-9);
  std::string deep;
  for (int i = 0; i < 100; ++i) deep += "<v:a xmlns:v=\"urn:v\">";
  for (int i = 0; i < 100; ++i) deep += "</v:a>";
  EXPECT_THAT(refused(model("", deep + cube, item(1)), {}), HasSubstr("more than 64 deep"));
  // A small archive whose directory promises 300 MiB: refused before any of it is unpacked.
  const std::string path = write(text);
  std::ifstream in(path, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::size_t entry = bytes.rfind("PK\1\2");
  ASSERT_NE(entry, bytes.npos);
  bytes.replace(entry + 24, 4, std::string("\0\0\xc0\x12", 4));
  std::ofstream(path, std::ios::binary) << bytes;
  EXPECT_THAT(refused(path), HasSubstr("times its size; expected a mesh"));
}

TEST_F(Model3mf, AnyTextIsReadOrRefused) {
  // Changes of a sound file: whatever comes of them is a mesh or an InputError.
  const std::string text = model(
      kBeamSpace + kSliceSpace + kMaterialSpace + "requiredextensions=\"b s\"",
      R"(<s:slicestack id="3" zbottom="0"><s:slice ztop="1"><s:vertices><s:vertex x="0" y="0"/><s:vertex x="1" y="0"/><s:vertex x="0" y="1"/></s:vertices><s:polygon startv="0"><s:segment v2="1"/><s:segment v2="2"/><s:segment v2="0"/></s:polygon></s:slice></s:slicestack>)" +
          object(
              1,
              mesh_of(
                  kCube,
                  R"(<b:beamlattice radius="1" minlength="0.1"><b:beams><b:beam v1="0" v2="7"/></b:beams></b:beamlattice>)")) +
          object(2, mesh_of(kCube), R"(s:slicestackid="3" s:meshresolution="lowres")"),
      item(1) + item(2, "transform=\"1 0 0 0 1 0 0 0 1 20 0 0\""));
  EXPECT_GT(inspect(read(text, {})).volume, 1000);
  std::mt19937 random(3);
  int good = 0, bad = 0;
  for (int round = 0; round < 400; ++round) {
    std::string changed = text;
    const int changes = std::uniform_int_distribution(1, 3)(random);
    for (int i = 0; i < changes; ++i) {
      const auto at = std::uniform_int_distribution<std::size_t>(0, changed.size() - 2)(random);
      const int how = std::uniform_int_distribution(0, 2)(random);
      if (how == 0) changed[at] = static_cast<char>(std::uniform_int_distribution(1, 255)(random));
      if (how == 1) changed.erase(at, std::uniform_int_distribution<std::size_t>(1, 20)(random));
      if (how == 2)
        changed.insert(
            at, changed.substr(
                    std::uniform_int_distribution<std::size_t>(0, changed.size() - 1)(random), 12));
    }
    try {
      const TriangleMesh mesh = read_mesh(write(changed));
      ++good;
      for (const auto& t : mesh.triangles) {
        for (const std::uint32_t v : t) ASSERT_LT(v, mesh.vertices.size());
      }
    } catch (const InputError&) {
      ++bad;
    }
  }
  EXPECT_GT(good, 2);
  EXPECT_GT(bad, 100);
}

// A block of 20 x 20 x 10 with a smaller one, which may be anything.
std::string two_blocks() {
  using test::operator+;
  return mesh_of(test::box({0, 0, 0}, {20, 20, 10}) + test::box({5, 5, -5}, {15, 15, 25}));
}

std::string prusa_config(const std::string& type) {
  return R"(<?xml version="1.0"?><config><object id="1"><volume firstid="0" lastid="11"><metadata type="volume" key="volume_type" value="ModelPart"/></volume><volume firstid="12" lastid="23">)" +
         type + "</volume></object></config>";
}

TEST_F(Model3mf, VolumesOfPrusaProjects) {
  const std::string text = model("", object(1, two_blocks()), item(1));
  const auto with = [&](const std::string& config) {
    return read(text, {{"Metadata/Slic3r_PE_model.config", config}});
  };
  const auto kind = [&](const std::string& type) {
    return with(
        prusa_config("<metadata type=\"volume\" key=\"volume_type\" value=\"" + type + "\"/>"));
  };
  EXPECT_NEAR(sliced_mm3(kind("NegativeVolume"), 0.5), 3000, 1e-6);
  EXPECT_THAT(notes_, ElementsAre("1 negative volume taken away from the part"));
  for (const auto& [type, note] : std::map<std::string, std::string>{
           {"ParameterModifier", "1 modifier left out: no part"},
           {"SupportBlocker", "1 support blocker left out: no part"},
           {"SupportEnforcer", "1 support enforcer left out: no part"}}) {
    EXPECT_NEAR(inspect(kind(type)).volume, 4000, 1e-9) << type;
    EXPECT_THAT(notes_, ElementsAre(note));
  }
  EXPECT_NEAR(sliced_mm3(kind("ModelPart"), 0.5), 4000 + 100 * 20, 1e-6);
  EXPECT_THAT(notes_, IsEmpty());
  std::string all = prusa_config("");
  all =
      all.substr(0, all.find("<volume")) +
      R"(<volume firstid="0" lastid="23"><metadata type="volume" key="volume_type" value="NegativeVolume"/></volume></object></config>)";
  EXPECT_THAT(refused(text, {{"Metadata/Slic3r_PE_model.config", all}}),
              HasSubstr("holds no triangles that print: 1 negative volume"));
  // What older versions wrote for modifiers.
  EXPECT_NEAR(
      inspect(with(prusa_config("<metadata type=\"volume\" key=\"modifier\" value=\"1\"/>")))
          .volume,
      4000, 1e-9);
  const auto bad = [&](const std::string& config) {
    return refused(text, {{"Metadata/Slic3r_PE_model.config", config}});
  };
  EXPECT_THAT(
      bad(prusa_config("<metadata type=\"volume\" key=\"volume_type\" value=\"Odd\"/>")),
      HasSubstr("Metadata/Slic3r_PE_model.config, line 1: a volume of the unknown kind 'Odd'"));
  std::string beyond = prusa_config("");
  beyond.replace(beyond.find("lastid=\"23\""), 11, "lastid=\"24\"");
  EXPECT_THAT(bad(beyond),
              HasSubstr("a volume of the triangles 12 to 24 of object 1, which has 24"));
  EXPECT_THAT(bad("<config"), HasSubstr("Slic3r_PE_model.config"));
  // Two copies: each loses its own.
  const TriangleMesh two = read(
      model("", object(1, two_blocks()),
            item(1) + item(1, "transform=\"0 1 0 -1 0 0 0 0 1 50 0 0\"")),
      {{"Metadata/Slic3r_PE_model.config",
        prusa_config("<metadata type=\"volume\" key=\"volume_type\" value=\"NegativeVolume\"/>")}});
  EXPECT_NEAR(sliced_mm3(two, 0.5), 6000, 1e-6);
}

TEST_F(Model3mf, VolumesBelongToTheirObject) {
  // The second object stands where the first one's hole is: it prints.
  const std::string text =
      model("", object(1, two_blocks()) + object(2, mesh_of(test::box({6, 6, 0}, {14, 14, 10}))),
            item(1) + item(2));
  const TriangleMesh mesh = read(
      text,
      {{"Metadata/Slic3r_PE_model.config",
        prusa_config("<metadata type=\"volume\" key=\"volume_type\" value=\"NegativeVolume\"/>")}});
  EXPECT_NEAR(sliced_mm3(mesh, 0.5), 3000 + 640, 1e-6);
}

TEST_F(Model3mf, PartsOfBambuProjects) {
  const std::string text = model(
      "",
      object(1, mesh_of(test::box({0, 0, 0}, {20, 20, 10}))) +
          object(2, mesh_of(test::box({5, 5, 0}, {15, 15, 10}))) +
          object(
              3,
              R"(<components><component objectid="1"/><component objectid="2" transform="-1 0 0 0 1 0 0 0 1 20 0 0"/></components>)"),
      item(3));
  const auto with = [&](const std::string& kind) {
    return Parts{
        {"Metadata/model_settings.config",
         R"(<?xml version="1.0"?><config><object id="3"><metadata key="name" value="x"/><part id="1" subtype="normal_part"/><part id="2" subtype=")" +
             kind +
             R"("/></object><plate><metadata key="plater_id" value="1"/></plate></config>)"}};
  };
  EXPECT_NEAR(sliced_mm3(read(text, with("negative_part")), 0.5), 3000, 1e-6);
  EXPECT_NEAR(inspect(read(text, with("modifier_part"))).volume, 4000, 1e-9);
  EXPECT_NEAR(inspect(read(text, with("support_blocker"))).volume, 4000, 1e-9);
  EXPECT_NEAR(inspect(read(text, with("support_enforcer"))).volume, 4000, 1e-9);
  EXPECT_NEAR(sliced_mm3(read(text, with("normal_part")), 0.5), 4000, 1e-6);
  EXPECT_THAT(refused(text, with("odd_part")), HasSubstr("unknown kind 'odd_part'"));
  Parts other = with("negative_part");
  other[0].second.replace(other[0].second.find("part id=\"2\""), 11, "part id=\"7\"");
  EXPECT_THAT(refused(text, other), HasSubstr("the object has no such component"));
}

TEST_F(Model3mf, TypesThatAreNoParts) {
  const std::string all =
      object(1, mesh_of(kCube)) + object(2, mesh_of(kCube), "type=\"support\"") +
      object(3, mesh_of(kCube), "type=\"surface\"") +
      object(4, mesh_of(kCube), "type=\"solidsupport\"") +
      object(5, mesh_of(kCube), "type=\"other\"") +
      object(
          6,
          R"(<components><component objectid="1"/><component objectid="2"/><component objectid="5"/></components>)");
  const auto moved = [](int id, int by) {
    return item(id, "transform=\"1 0 0 0 1 0 0 0 1 " + std::to_string(20 * by) + " 0 0\"");
  };
  const MeshReport r = inspect(read(
      model("", all, moved(1, 0) + moved(2, 1) + moved(3, 2) + moved(4, 3) + moved(6, 4)), {}));
  EXPECT_NEAR(r.volume, 3000, 1e-9);
  EXPECT_THAT(notes_, ElementsAre("2 objects of the type 'support' left out: no solid",
                                  "1 object of the type 'surface' left out: no solid",
                                  "1 object of the type 'other' left out: no part"));
}

// Beams between (0, 0, 0), (10, 0, 0), (0, 10, 0) and (0, 0, 10).
std::string lattice(const std::string& attributes, const std::string& beams,
                    const std::string& more = "") {
  return "<mesh><vertices>" + vertices({{{0, 0, 0}, {10, 0, 0}, {0, 10, 0}, {0, 0, 10}}, {}}) +
         "</vertices><triangles/><b:beamlattice " + attributes + "><b:beams>" + beams +
         "</b:beams>" + more + "</b:beamlattice></mesh>";
}

TEST_F(Model3mf, BeamsAreRoundWithinTheirTolerance) {
  const auto beams = [&](const std::string& attributes, const std::string& text,
                         const std::string& more = "") {
    return read(model(kBeamSpace + kBallSpace + "requiredextensions=\"b\"",
                      object(1, lattice(attributes, text, more)), item(1)),
                {});
  };
  constexpr double pi = std::numbers::pi, tolerance = 0.004;
  // A cylinder with flat ends: all corners lie as far from the axis as its tolerance says, and the
  // volume is that of the round one.
  const TriangleMesh butt =
      beams(R"(radius="2" minlength="0.01" cap="butt")", R"(<b:beam v1="0" v2="3"/>)");
  for (const auto& t : butt.triangles) {
    const bool end = butt.vertices[t[0]][2] == butt.vertices[t[1]][2] &&
                     butt.vertices[t[0]][2] == butt.vertices[t[2]][2];
    for (std::size_t k = 0; k < 3; ++k) {
      const Point3 &a = butt.vertices[t[k]], &b = butt.vertices[t[(k + 1) % 3]];
      EXPECT_LE(std::abs(std::hypot(a[0], a[1]) - 2), tolerance);
      // The middles of edges around the axis are those that lie deepest.
      if (!end && a[2] == b[2] && std::hypot(a[0] - b[0], a[1] - b[1]) < 1) {
        EXPECT_LE(std::abs(std::hypot(a[0] + b[0], a[1] + b[1]) / 2 - 2), tolerance);
      }
    }
  }
  EXPECT_NEAR(inspect(butt).volume, pi * 4 * 10, 1e-9);
  EXPECT_FALSE(inspect(butt).defects.any()) << describe(inspect(butt).defects);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("1 beam with round faces")));
  // Frusta.
  EXPECT_NEAR(inspect(beams(R"(radius="2" minlength="0.01" cap="butt")",
                            R"(<b:beam v1="0" v2="1" r1="1" r2="3"/>)"))
                  .volume,
              pi * 10 * (1 + 3 + 9) / 3, 1e-9);
  // Balls at the ends, whole or half, are the same where radii are. Faces within the tolerance on
  // either side: the volume of half balls is off by no more than surface times tolerance.
  const double capsule = pi * 4 * 10 + 4 * pi / 3 * 8;
  const double off = (2 * pi * 2 * 10 + 4 * pi * 4) * tolerance;
  EXPECT_NEAR(
      sliced_mm3(beams(R"(radius="2" minlength="0.01" cap="sphere")", R"(<b:beam v1="0" v2="1"/>)"),
                 0.1),
      capsule, off);
  const TriangleMesh domes =
      beams(R"(radius="2" minlength="0.01" cap="hemisphere")", R"(<b:beam v1="0" v2="1"/>)");
  EXPECT_NEAR(inspect(domes).volume, capsule, off);
  EXPECT_FALSE(inspect(domes).defects.any()) << describe(inspect(domes).defects);
  for (const auto& t : domes.triangles) {
    for (const std::uint32_t v : t) {
      const Point3& p = domes.vertices[v];
      const double along = p[0] < 0 ? p[0] : p[0] > 10 ? p[0] - 10 : 0;
      EXPECT_LE(std::abs(std::hypot(along, p[1], p[2]) - 2), tolerance);
    }
  }
  // One end each way.
  EXPECT_NEAR(inspect(beams(R"(radius="2" minlength="0.01" cap="butt")",
                            R"(<b:beam v1="2" v2="0" cap2="hemisphere"/>)"))
                  .volume,
              pi * 40 + 2 * pi / 3 * 8, off);
  // A ball at each vertex, or at some.
  const TriangleMesh balls =
      beams(R"(radius="0.5" minlength="0.01" cap="butt" b2:ballmode="mixed" b2:ballradius="3")",
            R"(<b:beam v1="0" v2="1"/>)",
            R"(<b2:balls><b2:ball vindex="0"/><b2:ball vindex="1" r="2"/></b2:balls>)");
  // The balls, and of the beam what lies between them: without the caps of balls on its axis.
  const auto lens = [](double ball) {  // of the beam inside half of the ball
    const double h = std::sqrt(ball * ball - 0.25);
    return std::numbers::pi * 0.25 * h +
           std::numbers::pi * (ball - h) * (ball - h) * (3 * ball - (ball - h)) / 3;
  };
  const double expected = 4 * pi / 3 * (27 + 8) + pi * 0.25 * 10 - lens(3) - lens(2);
  EXPECT_NEAR(sliced_mm3(balls, 0.1), expected, (4 * pi * 13 + pi * 10) * tolerance);
  EXPECT_NEAR(
      inspect(
          beams(R"(radius="0.5" minlength="0.01" cap="butt" b2:ballmode="all" b2:ballradius="3")",
                R"(<b:beam v1="0" v2="1"/>)"))
          .volume,
      2 * 4 * pi / 3 * 27 + pi * 0.25 * 10, 4 * pi * 18 * tolerance);
  // A larger print is cut finer: tolerances are those of what prints.
  const std::string path = write(model(
      kBeamSpace,
      object(1, lattice(R"(radius="2" minlength="0.01" cap="butt")", R"(<b:beam v1="0" v2="3"/>)")),
      item(1)));
  EXPECT_GT(read_mesh(path, {Units::automatic, 25, {}}).triangles.size(),
            4 * butt.triangles.size());
}

TEST_F(Model3mf, BeamsAreUnitedClippedAndChecked) {
  constexpr double pi = std::numbers::pi;
  const auto text = [&](const std::string& attributes, const std::string& beams) {
    return model(kBeamSpace + "requiredextensions=\"b\"",
                 object(5, mesh_of(test::box({-5, -5, -5}, {5, 5, 5}))) +
                     object(1, lattice(attributes, beams)),
                 item(1));
  };
  const std::string one = R"(<b:beam v1="0" v2="3"/>)";
  const std::string plain = R"(radius="1" minlength="0.01" cap="butt" )";
  // The same beam twice is one.
  EXPECT_NEAR(sliced_mm3(read(text(plain, one + one), {}), 0.1), pi * 10, 0.02);
  EXPECT_NEAR(
      sliced_mm3(read(text(plain + R"(clippingmode="inside" clippingmesh="5")", one), {}), 0.1),
      pi * 5, 0.01);
  // The part is no larger than what it is kept within: so it stands on the platform.
  EXPECT_EQ(
      inspect(read(text(plain + R"(clippingmode="inside" clippingmesh="5")", one), {})).upper[2],
      5);
  EXPECT_NEAR(
      sliced_mm3(read(text(plain + R"(clippingmode="outside" clippingmesh="5")", one), {}), 0.1),
      pi * 5, 0.01);
  EXPECT_NEAR(sliced_mm3(read(text(plain + R"(clippingmode="none")", one), {}), 0.1), pi * 10,
              0.02);
  // Too short to count.
  EXPECT_NEAR(inspect(read(text(R"(radius="1" minlength="11" cap="butt")",
                                one + R"(<b:beam v1="1" v2="2"/>)"),
                           {}))
                  .volume,
              pi * std::sqrt(200.0), 1e-9);
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("2 beams with round faces"),
                                  "1 beam left out: shorter than the file's least length"));
  const struct {
    std::string attributes, beams, why;
  } wrong[] = {
      {R"(minlength="0.01")", one, "lacks the attribute 'radius'"},
      {R"(radius="0" minlength="0.01")", one, "a number above 0 expected for radius"},
      {plain, R"(<b:beam v1="0" v2="4"/>)", "beam 1 of the object 1: vertex 4"},
      {plain, R"(<b:beam v1="0" v2="0"/>)", "begins and ends at one vertex"},
      {plain, R"(<b:beam v1="0" v2="1" r2="1"/>)", "r2 without r1"},
      {plain, R"(<b:beam v1="0" v2="1" r1="-1"/>)", "above 0 expected for r1"},
      {plain, R"(<b:beam v1="0" v2="1" cap1="round"/>)", "a cap 'round'"},
      {plain, "<b:bar/>", "unknown element 'bar'"},
      {plain + R"(clippingmode="inside")", one, "lacks the attribute 'clippingmesh'"},
      {plain + R"(clippingmode="inside" clippingmesh="1")", one, "clippingmesh 1 is no object"},
      {plain + R"(clippingmode="around" clippingmesh="5")", one, "clippingmode 'around'"},
  };
  for (const auto& [attributes, beams, why] : wrong) {
    EXPECT_THAT(refused(text(attributes, beams), {}), HasSubstr(why)) << attributes << beams;
  }
}

std::string slice_of(double top, const std::string& points, const std::string& polygons) {
  return "<s:slice ztop=\"" + std::to_string(top) + "\"><s:vertices>" + points + "</s:vertices>" +
         polygons + "</s:slice>";
}

TEST_F(Model3mf, SlicesAreWhatPrints) {
  const std::string square =
      R"(<s:vertex x="2" y="2"/><s:vertex x="8" y="2"/><s:vertex x="8" y="8"/><s:vertex x="2" y="8"/>)"
      R"(<s:vertex x="4" y="4"/><s:vertex x="6" y="4"/><s:vertex x="6" y="6"/><s:vertex x="4" y="6"/>)";
  const std::string outside =
      R"(<s:polygon startv="0"><s:segment v2="1"/><s:segment v2="2"/><s:segment v2="3"/><s:segment v2="0"/></s:polygon>)";
  const std::string hole =
      R"(<s:polygon startv="4"><s:segment v2="7"/><s:segment v2="6"/><s:segment v2="5"/><s:segment v2="4"/></s:polygon>)";
  const auto text = [&](const std::string& stack,
                        const std::string& attributes = R"(s:meshresolution="lowres")",
                        const std::string& how = "") {
    return model(kSliceSpace + "requiredextensions=\"s\"",
                 stack + object(1, mesh_of(kCube), "s:slicestackid=\"3\" " + attributes),
                 item(1, how));
  };
  const auto stack = [](const std::string& content) {
    return "<s:slicestack id=\"3\" zbottom=\"1\">" + content + "</s:slicestack>";
  };
  // Thicknesses of their own, a hole, a slice without anything.
  const std::string three = stack(slice_of(3, square, outside + hole) + "<s:slice ztop=\"4\"/>" +
                                  slice_of(4.5, square, outside));
  const TriangleMesh mesh = read(text(three), {});
  EXPECT_THAT(notes_, ElementsAre(HasSubstr("1 object made of the slices in the file")));
  EXPECT_NEAR(inspect(mesh).volume, 2 * (36 - 4) + 0.5 * 36, 1e-9);
  EXPECT_NEAR(sliced_mm3(mesh, 0.25), 2 * (36 - 4) + 0.5 * 36, 1e-6);
  EXPECT_EQ(inspect(mesh).lower, (Point3{2, 2, 1}));
  EXPECT_EQ(inspect(mesh).upper, (Point3{8, 8, 4.5}));
  // Also where the mesh does not say that it only stands in; not where the slices can't lie so.
  EXPECT_NEAR(inspect(read(text(three, ""), {})).volume, 82, 1e-9);
  EXPECT_NEAR(inspect(read(text(three, "", R"(transform="0 1 0 -2 0 0 0 0 1 5 0 1")"), {})).volume,
              164, 1e-9);
  EXPECT_NEAR(inspect(read(text(three, "", R"(transform="1 0 0 0 0 1 0 -1 0 0 0 0")"), {})).volume,
              1000, 1e-9);
  EXPECT_THAT(
      notes_,
      ElementsAre(HasSubstr("slices, left out: turned out of their plane; the mesh counts")));
  EXPECT_THAT(
      refused(text(three, R"(s:meshresolution="lowres")", R"(transform="1 0 0 0 1 0 0 0 2 0 0 0")"),
              {}),
      HasSubstr("turned out of their plane"));
  // Contours that are not convex, one of them around two others that overlap: windings, as everywhere.
  const std::string star =
      R"(<s:vertex x="0" y="0"/><s:vertex x="6" y="0"/><s:vertex x="6" y="6"/><s:vertex x="3" y="2"/><s:vertex x="0" y="6"/>)";
  const std::string five =
      R"(<s:polygon startv="0"><s:segment v2="1"/><s:segment v2="2"/><s:segment v2="3"/><s:segment v2="4"/><s:segment v2="0"/></s:polygon>)";
  EXPECT_NEAR(sliced_mm3(read(text(stack(slice_of(2, star, five + five))), {}), 0.25), 24, 1e-6);
  // In another part, in two pieces; where the second begins does not matter.
  const Parts others{{"2D/a.model", model(kSliceSpace,
                                          "<s:slicestack id=\"7\" zbottom=\"1\">" +
                                              slice_of(2, square, outside) + "</s:slicestack>",
                                          "")},
                     {"2D/b.model", model(kSliceSpace,
                                          "<s:slicestack id=\"7\" zbottom=\"9\">" +
                                              slice_of(3, square, outside) + "</s:slicestack>",
                                          "")}};
  const std::string references = stack(
      R"(<s:sliceref slicestackid="7" slicepath="/2D/a.model"/><s:sliceref slicestackid="7" slicepath="/2D/b.model"/>)");
  EXPECT_NEAR(inspect(read(text(references), others)).volume, 72, 1e-9);
  EXPECT_NEAR(inspect(read(model(kSliceSpace,
                                 object(1, mesh_of(kCube),
                                        "s:slicestackid=\"7\" s:slicepath=\"/2D/a.model\""),
                                 item(1)),
                           others))
                  .volume,
              36, 1e-9);
  const struct {
    std::string stack, why;
  } wrong[] = {
      {stack(""), "slices that are none"},
      {stack(slice_of(1, square, outside)), "is not above what lies below it"},
      {stack(slice_of(3, square, outside) + slice_of(3, square, outside)),
       "is not above what lies below it"},
      {stack(
           slice_of(3, square,
                    R"(<s:polygon startv="0"><s:segment v2="1"/><s:segment v2="2"/></s:polygon>)")),
       "is not closed"},
      {stack(slice_of(3, square, hole)), "run clockwise"},
      {stack(
           slice_of(3, square,
                    R"(<s:polygon startv="0"><s:segment v2="8"/><s:segment v2="0"/></s:polygon>)")),
       "vertex 8"},
      {stack(slice_of(3, square, outside) +
             R"(<s:sliceref slicestackid="7" slicepath="/2D/a.model"/>)"),
       "expected one kind"},
      {stack(R"(<s:sliceref slicestackid="8" slicepath="/2D/a.model"/>)"),
       "there is no slicestack 8"},
      {stack(R"(<s:sliceref slicestackid="3" slicepath="/3D/3dmodel.model"/>)"),
       "of the same part"},
      {stack(
           R"(<s:sliceref slicestackid="7" slicepath="/2D/b.model"/><s:sliceref slicestackid="7" slicepath="/2D/a.model"/>)"),
       "is not above what lies below it"},
      {"", "there is no slicestack 3"},
  };
  for (const auto& [its, why] : wrong)
    EXPECT_THAT(refused(text(its), others), HasSubstr(why)) << its;
  EXPECT_THAT(refused(text(three, R"(s:meshresolution="fine")"), {}),
              HasSubstr("meshresolution 'fine'"));
}

}  // namespace
}  // namespace slicecorr::model_3mf_tests
