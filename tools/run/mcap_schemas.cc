// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// The definitions are those of ROS 2 and foxglove_msgs, without their comments.
#include "tools/run/mcap_schemas.h"

#include <initializer_list>
#include <string>
#include <string_view>

namespace soilvdb::tools {
namespace {

struct MessageType {
  std::string_view name, fields;
};

constexpr MessageType kSceneEntityDeletion = {"foxglove_msgs/SceneEntityDeletion",
                                              R"(builtin_interfaces/Time timestamp
uint8 MATCHING_ID=0
uint8 ALL=1
uint8 type
string id
)"};
constexpr MessageType kSceneEntity = {"foxglove_msgs/SceneEntity",
                                      R"(builtin_interfaces/Time timestamp
string frame_id
string id
builtin_interfaces/Duration lifetime
bool frame_locked
foxglove_msgs/KeyValuePair[] metadata
foxglove_msgs/ArrowPrimitive[] arrows
foxglove_msgs/CubePrimitive[] cubes
foxglove_msgs/SpherePrimitive[] spheres
foxglove_msgs/CylinderPrimitive[] cylinders
foxglove_msgs/LinePrimitive[] lines
foxglove_msgs/TriangleListPrimitive[] triangles
foxglove_msgs/TextPrimitive[] texts
foxglove_msgs/ModelPrimitive[] models
)"};
constexpr MessageType kKeyValuePair = {"foxglove_msgs/KeyValuePair", R"(string key
string value
)"};
constexpr MessageType kArrowPrimitive = {"foxglove_msgs/ArrowPrimitive", R"(geometry_msgs/Pose pose
float64 shaft_length
float64 shaft_diameter
float64 head_length
float64 head_diameter
foxglove_msgs/Color color
)"};
constexpr MessageType kPose = {"geometry_msgs/Pose", R"(geometry_msgs/Point position
geometry_msgs/Quaternion orientation
)"};
constexpr MessageType kPoint = {"geometry_msgs/Point", R"(float64 x
float64 y
float64 z
)"};
constexpr MessageType kQuaternion = {"geometry_msgs/Quaternion", R"(float64 x
float64 y
float64 z
float64 w
)"};
constexpr MessageType kColor = {"foxglove_msgs/Color", R"(float64 r
float64 g
float64 b
float64 a
)"};
constexpr MessageType kCubePrimitive = {"foxglove_msgs/CubePrimitive", R"(geometry_msgs/Pose pose
geometry_msgs/Vector3 size
foxglove_msgs/Color color
)"};
constexpr MessageType kWrench = {"geometry_msgs/Wrench", R"(geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
)"};
constexpr MessageType kVector3 = {"geometry_msgs/Vector3", R"(float64 x
float64 y
float64 z
)"};
constexpr MessageType kSpherePrimitive = {"foxglove_msgs/SpherePrimitive",
                                          R"(geometry_msgs/Pose pose
geometry_msgs/Vector3 size
foxglove_msgs/Color color
)"};
constexpr MessageType kCylinderPrimitive = {"foxglove_msgs/CylinderPrimitive",
                                            R"(geometry_msgs/Pose pose
geometry_msgs/Vector3 size
float64 bottom_scale
float64 top_scale
foxglove_msgs/Color color
)"};
constexpr MessageType kLinePrimitive = {"foxglove_msgs/LinePrimitive", R"(uint8 LINE_STRIP=0
uint8 LINE_LOOP=1
uint8 LINE_LIST=2
uint8 type
geometry_msgs/Pose pose
float64 thickness
bool scale_invariant
geometry_msgs/Point[] points
foxglove_msgs/Color color
foxglove_msgs/Color[] colors
uint32[] indices
)"};
constexpr MessageType kTriangleListPrimitive = {"foxglove_msgs/TriangleListPrimitive",
                                                R"(geometry_msgs/Pose pose
geometry_msgs/Point[] points
foxglove_msgs/Color color
foxglove_msgs/Color[] colors
uint32[] indices
)"};
constexpr MessageType kTextPrimitive = {"foxglove_msgs/TextPrimitive", R"(geometry_msgs/Pose pose
bool billboard
float64 font_size
bool scale_invariant
foxglove_msgs/Color color
string text
)"};
constexpr MessageType kModelPrimitive = {"foxglove_msgs/ModelPrimitive", R"(geometry_msgs/Pose pose
geometry_msgs/Vector3 scale
foxglove_msgs/Color color
bool override_color
string url
string media_type
uint8[] data
)"};
constexpr MessageType kHeader = {"std_msgs/Header", R"(builtin_interfaces/Time stamp
string frame_id
)"};
constexpr MessageType kGridMapInfo = {"grid_map_msgs/GridMapInfo", R"(float64 resolution
float64 length_x
float64 length_y
geometry_msgs/Pose pose
)"};
constexpr MessageType kFloat32MultiArray = {"std_msgs/Float32MultiArray",
                                            R"(std_msgs/MultiArrayLayout layout
float32[] data
)"};
constexpr MessageType kMultiArrayLayout = {"std_msgs/MultiArrayLayout",
                                           R"(std_msgs/MultiArrayDimension[] dim
uint32 data_offset
)"};
constexpr MessageType kMultiArrayDimension = {"std_msgs/MultiArrayDimension", R"(string label
uint32 size
uint32 stride
)"};
constexpr MessageType kTransformStamped = {"geometry_msgs/TransformStamped",
                                           R"(std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
)"};
constexpr MessageType kTransform = {"geometry_msgs/Transform", R"(geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
)"};

/// A message's definition with the definitions of its parts.
io::McapSchema schema_of(const char* name, std::string text,
                         std::initializer_list<MessageType> parts) {
  for (const MessageType& part : parts) {
    text.append(80, '=');
    text.append("\nMSG: ").append(part.name).append("\n").append(part.fields);
  }
  return {name, "ros2msg", text};
}

}  // namespace

io::McapSchema scene_update_schema() {
  return schema_of(
      "foxglove_msgs/msg/SceneUpdate", R"(foxglove_msgs/SceneEntityDeletion[] deletions
foxglove_msgs/SceneEntity[] entities
)",
      {kSceneEntityDeletion, kSceneEntity, kKeyValuePair, kArrowPrimitive, kPose, kPoint,
       kQuaternion, kColor, kCubePrimitive, kVector3, kSpherePrimitive, kCylinderPrimitive,
       kLinePrimitive, kTriangleListPrimitive, kTextPrimitive, kModelPrimitive});
}

io::McapSchema grid_map_schema() {
  return schema_of("grid_map_msgs/msg/GridMap", R"(std_msgs/Header header
grid_map_msgs/GridMapInfo info
string[] layers
string[] basic_layers
std_msgs/Float32MultiArray[] data
uint16 outer_start_index
uint16 inner_start_index
)",
                   {kHeader, kGridMapInfo, kPose, kPoint, kQuaternion, kFloat32MultiArray,
                    kMultiArrayLayout, kMultiArrayDimension});
}

io::McapSchema transforms_schema() {
  return schema_of("tf2_msgs/msg/TFMessage", R"(geometry_msgs/TransformStamped[] transforms
)",
                   {kTransformStamped, kHeader, kTransform, kVector3, kQuaternion});
}

io::McapSchema wrench_schema() {
  return schema_of("geometry_msgs/msg/WrenchStamped", R"(std_msgs/Header header
geometry_msgs/Wrench wrench
)",
                   {kHeader, kWrench, kVector3});
}

io::McapSchema load_schema() {
  return {"soilvdb.Load", "jsonschema", R"({
  "type": "object",
  "title": "soilvdb.Load",
  "description": "What a machine's bucket holds, and what it has cut since the beginning",
  "properties": {
    "machine": {"type": "string"},
    "time_s": {"type": "number", "description": "s, of the motions"},
    "bucket_m3": {"type": "number", "description": "m3, in the bucket, loose"},
    "cut_m3": {"type": "number", "description": "m3, cut so far, in place"},
    "bucket_kg": {"type": "number", "description": "kg, in the bucket; where soil moves"}
  }
}
)"};
}

}  // namespace soilvdb::tools
