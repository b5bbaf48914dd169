// SPDX-FileCopyrightText: 2026 The slicecorr authors
// SPDX-License-Identifier: Apache-2.0

/// Names of namespaces and of kinds of relations in a 3MF.
#pragma once

#include <string_view>

namespace slicecorr::detail::spaces_3mf {

inline constexpr std::string_view kCore =
    "http://schemas.microsoft.com/3dmanufacturing/core/2015/02";
inline constexpr std::string_view kMaterials =
    "http://schemas.microsoft.com/3dmanufacturing/material/2015/02";
inline constexpr std::string_view kProduction =
    "http://schemas.microsoft.com/3dmanufacturing/production/2015/06";
inline constexpr std::string_view kSlices =
    "http://schemas.microsoft.com/3dmanufacturing/slice/2015/07";
inline constexpr std::string_view kBeams =
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02";
inline constexpr std::string_view kBalls =
    "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07";
inline constexpr std::string_view kTriangleSets =
    "http://schemas.microsoft.com/3dmanufacturing/trianglesets/2021/07";
inline constexpr std::string_view kCompatibility =
    "http://schemas.openxmlformats.org/markup-compatibility/2006";
inline constexpr std::string_view kRelations =
    "http://schemas.openxmlformats.org/package/2006/relationships";
inline constexpr std::string_view kModelType =
    "http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel";
inline constexpr std::string_view kTicketType =
    "http://schemas.microsoft.com/3dmanufacturing/2013/01/printticket";
inline constexpr std::string_view kXmlSpace = "http://www.w3.org/XML/1998/namespace";

}  // namespace slicecorr::detail::spaces_3mf
