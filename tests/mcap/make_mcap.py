#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Makes an MCAP file of motions as CSV, by the format's specification and nothing of ours.

    make_mcap.py OUT [--chunk N] [--compression lz4|zstd] [--big-endian] [--no-summary] [--idl] [--crc 0]
                 KIND:TOPIC[:PARENT:CHILD]:CSV ...

KIND is joints, pose, tf or string, or of scans cloud, depth or camera; messages of all topics are in the order of their times. A chunk has N
messages; without, there are none. Compressed by the programs of those names.
"""
import argparse
import csv
import struct
import subprocess
import zlib

MAGIC = b'\x89MCAP0\r\n'
TYPES = {'joints': 'sensor_msgs/msg/JointState', 'pose': 'geometry_msgs/msg/PoseStamped',
         'tf': 'tf2_msgs/msg/TFMessage', 'string': 'std_msgs/msg/String',
         'cloud': 'sensor_msgs/msg/PointCloud2', 'depth': 'sensor_msgs/msg/Image',
         'camera': 'sensor_msgs/msg/CameraInfo'}


def text(s):
    return struct.pack('<I', len(s.encode())) + s.encode()


def record(op, content):
    return bytes([op]) + struct.pack('<Q', len(content)) + content


class Cdr:
    def __init__(self, big_endian):
        self.order = '>' if big_endian else '<'
        self.bytes = b''

    def put(self, kind, *values):
        for value in values:
            size = struct.calcsize(kind)
            self.bytes += b'\0' * (-len(self.bytes) % size) + struct.pack(self.order + kind, value)

    def text(self, s):
        self.put('I', len(s.encode()) + 1)
        self.bytes += s.encode() + b'\0'

    def message(self):
        return bytes([0, self.order == '<', 0, 0]) + self.bytes


def stamp_of(time):
    """Seconds as decimals, to seconds and nanoseconds."""
    whole, _, decimals = time.partition('.')
    return int(whole), int((decimals + '000000000')[:9])


def put_scan(cdr, kind, row):
    """What a message has behind its header: a cloud of the row's point and one without a return, an
    image of 2 x 1 depths, one of them missing, or the camera of that image."""
    order = cdr.order
    if kind == 'cloud':
        cdr.put('I', 1, 2, 4)
        for name, offset, datatype in [('x', 0, 7), ('y', 4, 7), ('z', 8, 8), ('intensity', 16, 4)]:
            cdr.text(name)
            cdr.put('I', offset)
            cdr.put('B', datatype)
            cdr.put('I', 1)
        data = struct.pack(order + 'ffdHffdH', float(row['x']), float(row['y']), float(row['z']), 9,
                           0, 0, float('nan'), 9)
        cdr.put('B', order == '>')
        cdr.put('I', 18, 36, len(data))
        cdr.bytes += data
        cdr.put('B', 0)
    elif kind == 'depth':
        cdr.put('I', 1, 2)
        cdr.text('16UC1')
        cdr.put('B', order == '>')
        data = struct.pack(order + 'HH', int(row['mm']), 0)
        cdr.put('I', len(data), len(data))
        cdr.bytes += data
    else:
        cdr.put('I', 1, 2)
        cdr.text('plumb_bob')
        cdr.put('I', 5)
        k = [float(row['f']), 0, float(row['c']), 0, float(row['f']), 0, 0, 0, 1]
        cdr.put('d', *[0] * 5, *k, 1, 0, 0, 0, 1, 0, 0, 0, 1, *k[:3], 0, *k[3:6], 0, *k[6:], 0)
        cdr.put('I', *[0] * 6)
        cdr.put('B', 0)


def message_of(kind, frames, row, big_endian):
    cdr = Cdr(big_endian)
    stamp = stamp_of(row.pop('time'))
    if kind == 'tf':
        cdr.put('I', 1)
    if kind == 'string':
        cdr.text('of no use')
        return stamp, cdr.message()
    cdr.put('i', stamp[0])
    cdr.put('I', stamp[1])
    cdr.text(frames[0] if frames else 'map')
    if kind in ('cloud', 'depth', 'camera'):
        put_scan(cdr, kind, row)
        return stamp, cdr.message()
    if kind == 'joints':
        names = [name for name, value in row.items() if value != '']
        cdr.put('I', len(names))
        for name in names:
            cdr.text(name)
        for numbers in ([float(row[name]) for name in names], [0.0] * len(names), []):
            cdr.put('I', len(numbers))
            cdr.put('d', *numbers)
        return stamp, cdr.message()
    if kind == 'tf':
        cdr.text(frames[1])
    cdr.put('d', *(float(row[name]) for name in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw')))
    return stamp, cdr.message()


def compress(data, compression):
    if not compression:
        return data
    return subprocess.run([compression, '-c', '-q'], input=data, stdout=subprocess.PIPE, check=True).stdout


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument('out')
    arguments.add_argument('motions', nargs='+')
    arguments.add_argument('--chunk', type=int, default=0)
    arguments.add_argument('--compression', default='')
    arguments.add_argument('--big-endian', action='store_true')
    arguments.add_argument('--no-summary', action='store_true')
    arguments.add_argument('--idl', action='store_true')
    arguments.add_argument('--encoding', default='cdr')
    arguments.add_argument('--no-crc', action='store_true')
    options = arguments.parse_args()

    heads, messages, types = [], [], []
    for channel, motion in enumerate(options.motions):
        kind, topic, *frames, file = motion.split(':')
        if kind not in types:
            types.append(kind)
            heads.append(record(3, struct.pack('<H', len(types)) + text(TYPES[kind]) +
                                text('ros2idl' if options.idl else 'ros2msg') + text('# as ROS has it')))
        heads.append(record(4, struct.pack('<HH', channel + 7, types.index(kind) + 1) + text(topic) +
                            text(options.encoding) + text('')))
        with open(file, newline='') as rows:
            for i, row in enumerate(csv.DictReader(rows)):
                stamp, data = message_of(kind, frames, row, options.big_endian)
                ns = max(0, stamp[0] * 10**9 + stamp[1])
                messages.append((ns, record(5, struct.pack('<HIQQ', channel + 7, i, ns, ns) + data)))
    messages.sort(key=lambda m: m[0])

    crc = (lambda data: 0) if options.no_crc else zlib.crc32
    data = MAGIC + record(1, text('ros2') + text('make_mcap.py'))
    if options.chunk == 0:
        data += b''.join(heads) + b''.join(m for _, m in messages)
    for begin in range(0, len(messages) if options.chunk else 0, options.chunk or 1):
        some = messages[begin:begin + options.chunk]
        plain = (b''.join(heads) if begin == 0 else b'') + b''.join(m for _, m in some)
        packed = compress(plain, options.compression)
        data += record(6, struct.pack('<QQQI', some[0][0], some[-1][0], len(plain), crc(plain)) +
                       text(options.compression) + struct.pack('<Q', len(packed)) + packed)
        data += record(7, struct.pack('<HI', 7, 0))  # an index, of nothing
    data += record(15, struct.pack('<I', crc(data)))
    if options.no_summary:
        data += record(2, struct.pack('<QQI', 0, 0, 0))
    else:
        start = len(data)
        summary = b''.join(heads)
        footer = bytes([2]) + struct.pack('<Q', 20) + struct.pack('<QQ', start, 0)
        data += summary + footer + struct.pack('<I', crc(summary + footer))
    with open(options.out, 'wb') as out:
        out.write(data + MAGIC)


if __name__ == '__main__':
    main()
