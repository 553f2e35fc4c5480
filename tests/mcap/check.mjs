// SPDX-FileCopyrightText: 2026 The soilvdb authors
// SPDX-License-Identifier: Apache-2.0
// Reads a run's soil.mcap by @mcap/core, its messages by the definitions in the file, and compares them
// with what the run's summary.json says.
//   node check.mjs RUN ORIGIN_X ORIGIN_Y [FILE]  a run on the plane z = 0 that cut away whole blocks, or a
//                                                folder `live` of a live site; soil.mcap or another of it
//   node check.mjs RUN.part                   one that was killed: what there is must be readable
import {strict as assert} from "node:assert";
import {open, readFile} from "node:fs/promises";
import {McapIndexedReader, McapStreamReader} from "@mcap/core";
import {loadDecompressHandlers} from "@mcap/support";
import {parse} from "@foxglove/rosmsg";
import {MessageReader} from "@foxglove/rosmsg2-serialization";

const decompressHandlers = await loadDecompressHandlers();
const text = new TextDecoder();

class Decoder {
  readers = new Map();
  decode(schema, channel, message) {
    if (channel.messageEncoding === "json") return JSON.parse(text.decode(message.data));
    assert.equal(channel.messageEncoding, "cdr");
    assert.equal(schema.encoding, "ros2msg");
    if (!this.readers.has(schema.id)) {
      const definitions = parse(text.decode(schema.data), {ros2: true});
      this.readers.set(schema.id, new MessageReader(definitions));
    }
    return this.readers.get(schema.id).readMessage(message.data);
  }
}

/// Everything, by topic, as a reader has it that doesn't need the index.
async function stream(file) {
  const reader = new McapStreamReader({validateCrcs: true, decompressHandlers});
  reader.append(await readFile(file));
  const schemas = new Map(), channels = new Map(), topics = new Map(), decoder = new Decoder();
  for (let record; (record = reader.nextRecord());) {
    if (record.type === "Schema") schemas.set(record.id, record);
    if (record.type === "Channel") channels.set(record.id, record);
    if (record.type !== "Message") continue;
    const channel = channels.get(record.channelId), schema = schemas.get(channel.schemaId);
    if (!topics.has(channel.topic)) topics.set(channel.topic, {schema, messages: []});
    const {messages} = topics.get(channel.topic);
    if (messages.length) assert(messages.at(-1).logTime <= record.logTime, "times don't go back");
    messages.push({logTime: record.logTime, data: decoder.decode(schema, channel, record)});
  }
  return {topics, done: reader.done()};
}

/// The same by the index at the file's end.
async function indexed(file) {
  const handle = await open(file);
  try {
    const readable = {
      size: async () => BigInt((await handle.stat()).size),
      read: async (offset, length) => {
        const bytes = new Uint8Array(Number(length));
        const {bytesRead} = await handle.read(bytes, 0, bytes.length, Number(offset));
        assert.equal(bytesRead, bytes.length);
        return bytes;
      },
    };
    const reader = await McapIndexedReader.Initialize({readable, decompressHandlers});
    const counts = new Map(), metadata = [];
    for await (const message of reader.readMessages()) {
      const {topic} = reader.channelsById.get(message.channelId);
      counts.set(topic, (counts.get(topic) ?? 0) + 1);
    }
    for await (const record of reader.readMetadata()) metadata.push(record);
    return {counts, metadata, statistics: reader.statistics, chunks: reader.chunkIndexes.length};
  } finally {
    await handle.close();
  }
}

/// What the entities are after all updates.
function entities(messages) {
  const all = new Map();
  let deleted = 0;
  for (const {data} of messages) {
    for (const {type, id} of data.deletions) {
      assert.equal(type, 0);
      assert(all.delete(id), `${id} was there`);
      ++deleted;
    }
    for (const entity of data.entities) all.set(entity.id, entity);
  }
  return {shown: all, deleted};
}

/// Volume between triangles and z = 0.
function volume({points, indices}) {
  let sum = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => points[indices[i + k]]);
    const twiceArea = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
    sum += (twiceArea / 2) * ((a.z + b.z + c.z) / 3);
  }
  return sum;
}

const [run, originX, originY, name = "soil.mcap"] = process.argv.slice(2);
if (run.endsWith(".part")) {
  const {topics, done} = await stream(run);
  assert(!done);
  assert(topics.get("/ground").messages.length > 0);
  process.exit(0);
}

const file = `${run}/${name}`;
const summary = JSON.parse(await readFile(`${run}/summary.json`));
if (!run.endsWith("live")) assert(summary.files.includes("soil.mcap"));
const {topics, done} = await stream(file);
assert(done);
const {counts, metadata, statistics, chunks} = await indexed(file);
assert.equal(chunks, statistics.chunkCount);
for (const [topic, {messages}] of topics) assert.equal(counts.get(topic), messages.length, topic);
assert.equal(Number(statistics.messageCount), [...counts.values()].reduce((a, b) => a + b));

const times = [...topics.values()].flatMap(({messages}) => messages.map((m) => m.logTime)).sort(
  (a, b) => (a < b ? -1 : 1));
assert.equal(statistics.messageStartTime, times[0]);
assert.equal(statistics.messageEndTime, times.at(-1));
const ns = ({sec, nanosec}) => BigInt(sec) * 1_000_000_000n + BigInt(nanosec);
for (const {logTime, data} of topics.get("/ground").messages)
  for (const {timestamp} of [...data.deletions, ...data.entities]) assert.equal(ns(timestamp), logTime);

const names = new Map([...topics].map(([topic, {schema}]) => [topic, schema.name]));
assert.equal(names.get("/ground"), "foxglove_msgs/msg/SceneUpdate");
assert.equal(names.get("/elevation"), "grid_map_msgs/msg/GridMap");
assert.equal(names.get("/tf_static"), "tf2_msgs/msg/TFMessage");

const [{transforms: [site]}] = topics.get("/tf_static").messages.map((m) => m.data);
assert.equal(site.header.frame_id, "world");
assert.equal(site.child_frame_id, "site");
const origin = site.transform.translation;
assert(Math.hypot(origin.x - originX, origin.y - originY) < 5000, "the site's origin is near");
assert.equal(metadata[0].name, "soilvdb");
assert.equal(metadata[0].metadata.get("origin"), `${origin.x} ${origin.y} ${origin.z}`);

for (const machine of summary.machines) {
  const {schema, messages} = topics.get(`/load/${machine.name}`);
  assert.equal(schema.encoding, "jsonschema");
  const last = messages.at(-1).data;
  assert.equal(last.machine, machine.name);
  assert.equal(last.bucket_m3, machine.bucket_m3);
  assert.equal(last.cut_m3, machine.cut_m3);
  const tenths = messages.slice(0, -1).map((m) => Math.floor(m.data.time_s * 10 + 1e-6));
  assert.equal(new Set(tenths).size, tenths.length, "ten a second at most");
  for (const {logTime, data} of messages) assert(Math.abs(Number(logTime) - data.time_s * 1e9) < 1e3);
}

// Forces are those of updates.csv and of a live site's answers, where they were asked for, and buckets are
// where their motion was then.
const lines = async (file) => (await readFile(file, "utf8")).trim().split("\n");
const near = (value, wanted, error) => assert(Math.abs(value - wanted) <= error, `${value} is ${wanted}`);
async function wantedForces(name) {
  if (run.endsWith("force_live")) {
    const answers = (await lines(`${run}/answers`)).map(JSON.parse), states = (await lines(`${run}/states`)).map(JSON.parse);
    return states.map(({time, position, rotation}, i) => ({time, position, rotation, force: answers[i].force_n, torque: answers[i].moment_nm}));
  }
  if (run.endsWith("live")) return [];
  const [head, ...updates] = (await lines(`${run}/updates.csv`)).map((row) => row.split(","));
  if (!head.includes("force_x_n")) return [];
  const [, ...motion] = (await lines(`${run}.csv`)).map((row) => row.split(",").map(Number));
  return updates.filter((row) => row[1] === name).map((row) => {
    const [x, y, z, turn] = row.slice(head.indexOf("force_x_n")).map(Number), time = Number(row[0]);
    const i = Math.max(1, motion.findIndex((at) => at[0] >= time)), [a, b] = [motion[i - 1], motion[i]];
    const at = a.map((value, k) => value + ((time - a[0]) / (b[0] - a[0])) * (b[k] - value));
    return {time, position: at.slice(1, 4), rotation: [0, 0, Math.sin(at[4] / 2), Math.cos(at[4] / 2)], force: [x, y, z], torque: [, turn]};
  });
}
for (const {name} of summary.machines) {
  const wanted = await wantedForces(name);
  assert.equal(topics.has("/tf"), wanted.length > 0);
  if (wanted.length === 0) continue;
  const {schema, messages} = topics.get(`/${name}/soil_wrench`), places = topics.get("/tf").messages
    .filter(({data: {transforms: [place]}}) => place.child_frame_id === `${name}_bucket`);
  assert.equal(schema.name, "geometry_msgs/msg/WrenchStamped");
  assert.equal(messages.length, wanted.length);
  assert.equal(places.length, wanted.length);
  wanted.forEach((at, i) => {
    const {logTime, data: {header, wrench}} = messages[i], [place, ...more] = places[i].data.transforms;
    assert.equal(more.length, 0);
    assert.equal(header.frame_id, `${name}_bucket`);
    assert.equal(place.header.frame_id, "world");
    for (const stamp of [header.stamp, place.header.stamp]) assert.equal(ns(stamp), logTime);
    assert.equal(places[i].logTime, logTime);
    near(Number(logTime), at.time * 1e9, 1e3);
    ["x", "y", "z"].forEach((axis, k) => {
      for (const part of ["force", "torque"])
        if (at[part][k] !== undefined) near(wrench[part][axis], at[part][k], 1e-5 * Math.abs(at[part][k]) + 1e-9);
      near(place.transform.translation[axis], at.position[k], 1e-5);
    });
    ["x", "y", "z", "w"].forEach((axis, k) => near(place.transform.rotation[axis], at.rotation[k], 1e-9));
  });
  assert(Math.max(...wanted.map(({force}) => -force[0])) > 1000, "it digs");
}

// The ledger counts samples, the mesh is true to a thousandth of what was cut.
const {shown, deleted} = entities(topics.get("/ground").messages);
assert(shown.size > 0 && (deleted > 0 || run.endsWith("live") || run.endsWith("force")));
let meshed = 0;
for (const {frame_id, triangles} of shown.values()) {
  assert.equal(frame_id, "site");
  assert.equal(triangles.length, 1);
  const [{points, indices}] = triangles;
  assert(indices.length % 3 === 0 && indices.every((i) => i < points.length));
  meshed += volume({points: points.map((p) => ({...p, z: p.z + origin.z})), indices});
}
const change = summary.volume_m3.ground_change;
assert(Math.abs(meshed - change) < 0.005 * summary.volume_m3.cut, `${meshed} for ${change}`);

const map = topics.get("/elevation").messages.at(-1).data;
assert.deepEqual(map.layers, ["elevation"]);
assert.equal(map.header.frame_id, "site");
const [{layout, data}] = map.data;
const [columns, rows] = layout.dim;
assert.equal(columns.label, "column_index");
assert.equal(rows.label, "row_index");
assert.equal(data.length, columns.size * rows.size);
assert(Math.abs(map.info.length_x - rows.size * map.info.resolution) < 1e-9);
assert(Math.abs(map.info.length_y - columns.size * map.info.resolution) < 1e-9);
let below = 0, lowest = {z: 0};
data.forEach((z, i) => {
  const height = z + origin.z, area = map.info.resolution ** 2;
  if (Math.abs(height) > 1e-6) below += height * area;
  const row = i % rows.size, column = Math.floor(i / rows.size);
  const x = map.info.pose.position.x + map.info.length_x / 2 - (row + 0.5) * map.info.resolution;
  const y = map.info.pose.position.y + map.info.length_y / 2 - (column + 0.5) * map.info.resolution;
  if (height < lowest.z) lowest = {x, y, z: height};
});
// Heights at the middles of cells, which walls cut.
assert(Math.abs(below - change) < 0.1 * summary.volume_m3.cut, `${below} for ${change}`);
// The deepest cell is where the mesh is deepest: x and y aren't swapped or turned round.
let nearest = Infinity;
for (const {triangles: [{points}]} of shown.values())
  for (const p of points)
    if (p.z + origin.z < 0.9 * lowest.z) nearest = Math.min(nearest, Math.hypot(p.x - lowest.x, p.y - lowest.y));
assert(nearest < 2 * map.info.resolution, "the map lies where the ground is");
// What was above it is gone.
const over = ({points, indices}) => {
  let count = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const [a, b, c] = [0, 1, 2].map((k) => points[indices[i + k]]);
    const side = (p, q) => (q.x - p.x) * (lowest.y - p.y) - (q.y - p.y) * (lowest.x - p.x);
    const sides = [side(a, b), side(b, c), side(c, a)];
    if (sides.every((v) => v > 0) || sides.every((v) => v < 0)) ++count;
  }
  return count;
};
assert([...shown.values()].reduce((n, {triangles: [t]}) => n + over(t), 0) <= 1);
console.log(`${file}: ${[...counts].map(([topic, n]) => `${topic} ${n}`).join(", ")}`);
