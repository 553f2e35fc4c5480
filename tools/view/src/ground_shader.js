// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Shaders of the ground: terrain tiles, which are hidden where chunks are resident, and blocks. One
// function colours both, so that the borders between them are invisible.

const kColouring = /* glsl */ `
uniform int mode;               // see ground_uniforms.js
uniform sampler2D ramps, clod_light, drape, sigmas;
uniform bool draped, compares;  // compares: changes are not since the survey
uniform vec4 drape_box;         // west and north border in the scene, 1 / width, 1 / height
uniform vec4 sigma_box;         // west and south border in the scene, 1 / width, 1 / height
uniform float least_sigma_m;     // of the scale, which is logarithmic and goes to a hundred times that
uniform float undug_m;          // smaller changes since the survey are errors of meshes
uniform float most_m, dead_m, step_m, low_m, high_m, contour_m, grid_m, clod_m, exposure, pixel_ratio;
uniform vec2 grid_from_m;       // coordinates of the scene's origin, less a multiple of the grid
uniform bool patterns;
uniform vec3 sun;

const vec3 kSoil = vec3(0.79, 0.725, 0.63);
const float kHalfUnit_m = 0.0005, kUnit_m = 0.001;         // changes are in mm
const float kChangeSlope = 0.02, kLevelSlope = 0.0005;   // 1 mm and 0.025 mm in a voxel of 5 cm
const vec3 kSection = vec3(0.50, 0.40, 0.31), kSectionDark = vec3(0.43, 0.335, 0.26);

vec3 ramp(int row, float share) {
  return texture2D(ramps, vec2((clamp(share, 0.0, 1.0) * 255.0 + 0.5) / 256.0, (float(row) + 0.5) / 6.0)).rgb;
}

// The share of a pixel that lines at the multiples of a step cover; 0 where lines would merge.
float lines(float value, float step_size, float width_px) {
  float u = value / step_size, w = fwidth(u);
  float off = abs(fract(u - 0.5) - 0.5) / max(w, 1e-6);
  return (1.0 - smoothstep(width_px - 0.5, width_px + 0.5, off)) * (1.0 - smoothstep(0.15, 0.4, w));
}

// Lines at the multiples of a step of a height. Where the height does not vary there is none: on
// ground exactly at a multiple, rounding errors would decide for each pixel.
// @param least_slope the height's errors, per metre
float height_lines(vec3 at, float height, float step_size, float least_slope) {
  float rise = fwidth(height), run = length(fwidth(at.xy));
  float sloping = smoothstep(least_slope, 2.0 * least_slope, rise / max(run, 1e-9)) * step(1e-6 * abs(height), rise);
  return lines(height, step_size, 0.7) * sloping;
}

// Loose soil is drawn as clods, as in soilvdb's pictures, so that no colour is needed. Their
// texture is projected along the axis closest to the normal.
vec3 clods(vec3 color, vec3 point, vec3 normal, float loose) {
  vec3 size = abs(normal), at = point / (16.0 * clod_m);
  vec2 uv = size.z >= max(size.x, size.y) ? at.xy : size.x >= size.y ? at.yz : at.xz;
  float light = 0.5 + texture2D(clod_light, uv).r;
  return color * mix(1.0, light, clamp(4.0 * (loose - 0.3) + 0.5, 0.0, 1.0));
}

vec3 lit(vec3 color, vec3 normal) {
  vec3 light = vec3(0.58, 0.61, 0.68) * (0.6 + 0.4 * normal.z) + vec3(0.84, 0.80, 0.73) * max(0.0, dot(normal, sun));
  return color * sqrt(light * exposure);   // as on linear colours, with a gamma of 2
}

// Diagonal stripes mean cut, dots mean fill.
vec3 marked(vec3 color, bool cut) {
  vec2 px = gl_FragCoord.xy / (7.0 * pixel_ratio);
  float mark = cut ? 1.0 - smoothstep(0.1, 0.25, abs(fract((px.x + px.y) * 0.7) - 0.5))
                   : 1.0 - smoothstep(0.18, 0.3, length(fract(px) - 0.5));
  return mix(color, cut ? vec3(0.1, 0.0, 0.0) : vec3(1.0), 0.25 * mark);
}

// @param change_m above (+) or below (-) the reference of the colours
// @param known    whether there is a reference
vec3 signed_color(vec3 at, vec3 soil, float change_m, bool known) {
  if (!known) return mix(soil, vec3(0.5), 0.6);
  float size = abs(change_m);
  if (size < dead_m - kHalfUnit_m) return soil;
  bool cut = mode == 4 ? change_m > 0.0 : change_m < 0.0;   // ground above the design must be cut
  vec3 color = mix(soil, ramp(cut ? 0 : 1, size / most_m), 0.75 + 0.25 * min(1.0, 4.0 * size / most_m));
  color *= 1.0 - 0.22 * height_lines(at, change_m, step_m, kChangeSlope);
  return patterns ? marked(color, cut) : color;
}

// The ground's own colour: the photo where it holds, with a white border to dug ground, else soil.
// @param surveyed the ground is as in the survey
vec3 ground_color(vec2 at, float change_m, bool surveyed, out bool photo) {
  vec2 uv = vec2(at.x - drape_box.x, drape_box.y - at.y) * drape_box.zw;
  float past_m = abs(change_m) - undug_m, width_m = max(fwidth(past_m), 1e-6);
  vec4 texel = draped ? texture2D(drape, uv) : vec4(0.0);
  bool inside = draped && texel.a > 0.5 && all(greaterThanEqual(uv, vec2(0.0))) && all(lessThanEqual(uv, vec2(1.0)));
  photo = inside && surveyed && past_m <= 0.0;
  vec3 color = texel.rgb;
  if (!photo) color = kSoil * (1.0 - 0.07 * max(lines(at.x + grid_from_m.x, grid_m, 0.6), lines(at.y + grid_from_m.y, grid_m, 0.6)));
  if (!inside) return color;
  float border = surveyed ? 1.0 - smoothstep(1.0, 2.0, abs(past_m) / width_m) : 0.0;
  return mix(color, vec3(1.0), border);
}

// The column's own sigma, where it was seen.
vec3 sigma_color(vec2 at, vec3 soil) {
  vec2 uv = (at - sigma_box.xy) * sigma_box.zw;
  float sigma_m = texture2D(sigmas, uv).r;
  if (any(lessThanEqual(uv, vec2(0.0))) || any(greaterThanEqual(uv, vec2(1.0))) || sigma_m < 0.0) return soil;
  return ramp(5, 0.5 * log2(sigma_m / least_sigma_m) / log2(10.0));
}

// @param above_low_m height above low_m: the scene's heights are too large for exact differences
// @param since_survey_m change since the survey, where that is known
vec3 colored(vec3 at, float above_low_m, float change_m, bool known, float loose, vec3 normal, float since_survey_m, bool surveyed) {
  bool photo;
  vec3 soil = ground_color(at.xy, since_survey_m, surveyed, photo), color = soil;
  if (mode == 0 || mode == 4) color = signed_color(at, soil, change_m, known);
  if (mode == 1 && -change_m >= max(dead_m, kUnit_m) - kHalfUnit_m) color = ramp(2, -change_m / most_m);
  if (mode == 2) {
    color = ramp(3, above_low_m / (high_m - low_m));
    if (photo) color *= 0.6 + 0.8 * dot(soil, vec3(0.3, 0.59, 0.11));   // its lightness, in the colours of the scale
    color *= 1.0 - 0.3 * height_lines(at, above_low_m + contour_m * fract(low_m / contour_m), contour_m, kLevelSlope);
  }
  if (mode == 3) color = mix(soil, ramp(4, loose), step(0.02, loose));
  if (mode == 5) color = sigma_color(at.xy, soil);
  return lit(clods(color, at, normal, loose), normal);
}
`;

const kResident = /* glsl */ `
uniform highp isampler2D chunks;
uniform int slot_mask, probes;
uniform ivec3 low_block, high_block;

bool resident(ivec3 chunk) {
  ivec3 block = chunk >> 2;
  if (any(lessThan(block, low_block)) || any(greaterThan(block, high_block))) return false;
  uint h = uint(block.x) * 73856093u ^ uint(block.y) * 19349663u ^ uint(block.z) * 83492791u;
  h = (h ^ (h >> 15)) * 0x85ebca77u;
  int slot = int((h ^ (h >> 13)) & uint(slot_mask));
  for (int i = 0; i < probes; ++i) {
    ivec2 at = ivec2((slot & 127) * 2, slot >> 7);
    ivec4 key = texelFetch(chunks, at, 0);
    if (key.w == 0) return false;
    if (key.xyz == block) {
      ivec4 mask = texelFetch(chunks, at + ivec2(1, 0), 0);
      ivec3 in_block = chunk & 3;
      int bit = (in_block.x * 4 + in_block.y) * 4 + in_block.z;
      return (((bit < 32 ? mask.x : mask.y) >> (bit & 31)) & 1) == 1;
    }
    slot = (slot + 1) & slot_mask;
  }
  return false;
}
`;

/** Tiles: some of their posts, each with its height above the scene's datum. */
export const kTerrainVertex = /* glsl */ `
attribute vec2 grid;
attribute float height;
attribute vec2 outward;        // of walls around the site; else 0
uniform float spacing_m, voxel_m, low_m;
uniform vec3 tile_fraction;    // position of the tile's corner within its voxel
varying vec3 scene_at, voxel_at;
varying vec2 grid_at, wall;
varying float above_low_m;
void main() {
  vec3 local = vec3(grid * spacing_m, height);
  voxel_at = local / voxel_m + tile_fraction;
  vec4 at = modelMatrix * vec4(local, 1.0);
  scene_at = at.xyz;
  above_low_m = at.z - low_m;
  grid_at = grid;
  wall = outward;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(local, 1.0);
}`;

export const kTerrainFragment = kColouring + kResident + /* glsl */ `
uniform ivec3 tile_voxel;      // voxel of the tile's corner; an integer, because floats have 24 bits
uniform float reach;           // largest distance of the triangles from the ground, voxels
uniform sampler2D normals, heights, above;   // of the posts: heights in the scene and above the design
uniform bool designed;
varying vec3 scene_at, voxel_at;
varying vec2 grid_at, wall;
varying float above_low_m;
const float kOverlap = 1.0;

// Bilinear between four posts, less a datum. Level ground has exactly the posts' value.
float between(sampler2D posts, float datum, out bool known) {
  ivec2 low = clamp(ivec2(grid_at), ivec2(0), textureSize(posts, 0) - 2);
  vec2 share = grid_at - vec2(low);
  vec4 four = vec4(texelFetch(posts, low, 0).r, texelFetch(posts, low + ivec2(1, 0), 0).r,
                   texelFetch(posts, low + ivec2(0, 1), 0).r, texelFetch(posts, low + ivec2(1, 1), 0).r);
  known = all(greaterThan(four, vec4(-1e8)));
  four -= datum;
  vec2 row = four.xz + share.x * (four.yw - four.xz);
  return row.x + share.y * (row.y - row.x);
}

bool covered(ivec2 column, int bottom, int top) {
  for (int z = bottom; z <= top; ++z) {
    if (resident(ivec3(column, z))) return true;
  }
  return false;
}

void main() {
  // Block meshes may end slightly inside their chunks, so terrain reaches a voxel below them.
  ivec2 low = (tile_voxel.xy + ivec2(floor(voxel_at.xy - kOverlap))) >> 3;
  ivec2 high = (tile_voxel.xy + ivec2(floor(voxel_at.xy + kOverlap))) >> 3;
  int bottom = (tile_voxel.z + int(floor(voxel_at.z - reach))) >> 3;
  int top = (tile_voxel.z + int(floor(voxel_at.z + reach))) >> 3;
  if (all(greaterThanEqual(low >> 2, low_block.xy)) && all(lessThanEqual(high >> 2, high_block.xy))) {
    if (covered(low, bottom, top) && (low == high || (covered(high, bottom, top) &&
        covered(ivec2(low.x, high.y), bottom, top) && covered(ivec2(high.x, low.y), bottom, top)))) discard;
  }
  if (length(wall) > 0.5) {
    float t = scene_at.z / max(0.5, 0.01 * grid_m * 10.0);
    float layers = clamp(0.5 + 0.28 * sin(2.1 * t) + 0.22 * sin(5.3 * t + 1.1), 0.0, 1.0);
    gl_FragColor = vec4(lit(mix(kSection, kSectionDark, layers), normalize(vec3(wall, 0.0))), 1.0);
    return;
  }
  vec3 normal = normalize(texture2D(normals, (grid_at + 0.5) / vec2(textureSize(normals, 0))).xyz);
  float height_m = above_low_m, above_m = 0.0;
  bool known = mode != 4;
  if (mode == 2) {
    float exact_m = between(heights, low_m, known);
    if (known) height_m = exact_m;
  }
  if (mode == 4 && designed) above_m = between(above, 0.0, known);
  gl_FragColor = vec4(colored(scene_at, height_m, known ? above_m : 0.0, known, 0.0, normal, 0.0, true), 1.0);
}`;

/** Blocks: positions are 16-bit lattice coordinates; the model's matrix converts them to metres. */
export const kBlockVertex = /* glsl */ `
attribute vec3 facing;
attribute float change, design, loose;
uniform int mode;
uniform float low_m;
varying vec3 scene_at, normal_at;
varying float above_low_m, change_m, unknown, loose_at, since_m;
void main() {
  float value = mode == 4 ? design : change;
  since_m = change < -32767.5 ? 1e3 : 0.001 * change;
  unknown = value < -32767.5 ? 1.0 : 0.0;
  change_m = unknown > 0.5 ? 0.0 : 0.001 * value;
  loose_at = loose;
  normal_at = facing;
  scene_at = (modelMatrix * vec4(position, 1.0)).xyz;
  above_low_m = scene_at.z - low_m;
  gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
}`;

export const kBlockFragment = kColouring + /* glsl */ `
varying vec3 scene_at, normal_at;
varying float above_low_m, change_m, unknown, loose_at, since_m;
void main() {
  vec3 normal = normalize(normal_at) * (gl_FrontFacing ? 1.0 : -1.0);
  gl_FragColor = vec4(colored(scene_at, above_low_m, change_m, unknown < 0.5, loose_at, normal, since_m, !compares), 1.0);
}`;
