#!/usr/bin/env python3
# SPDX-FileCopyrightText: 2026 The soilvdb authors
# SPDX-License-Identifier: Apache-2.0
"""Makes the seeds in tests/fuzz/corpus: small files of every kind that is read.

    tests/fuzz/make_corpus.py build/soilvdb     # needs gdal_translate, too
"""
import json
import pathlib
import re
import struct
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
CORPUS = HERE / 'corpus'

SCENARIO = '''soilvdb: 1
name: pit
voxel_size: 0.1
terrain:
  plane: {z: 0.0, slope: [0.1, 0.0]}
machines:
  - name: digger
    bucket: {width: 0.4, height: 0.3, profile: [[0, 0], [-0.2, 0.05], [0, 0.3]], dump_angle: 0.8}
    motion: motion.csv
output:
  snapshots: {every: 1.0}
  mesh: ply
  raster: {cell: 0.1}
  journal: {sync: always}
'''
BY_JOINTS = '''soilvdb: 1
voxel_size: 0.05
terrain: {raster: hills.tif}
machines:
  - name: one
    bucket: &b {width: 1.2, height: 1}
    motion: joints.csv
    urdf: machine.urdf
    base: {xyz: [1, 2, 3], rpy: [0, 0, 0.6]}
    lip: {link: b, xyz: [1.4, 0, 0], rpy: [3.14, 1.5, 0]}
  - {name: two, bucket: *b, motion: motion.csv}
'''
EARTHMOVING = '''soilvdb: 1
voxel_size: 0.1
terrain: {plane: {z: 0.0}}
soil: {repose_angle: 0.61, swell: 0.25, density: 1800, cohesion: 10000, friction_angle: 0.5}
machines:
  - name: digger
    bucket: {width: 0.4, height: 0.3, profile: [[0, 0], [-0.2, 0.05], [0, 0.3]]}
    motion: motion.csv
pours:
  - {name: truck, at: [5.0, 0.0, 3.0], time: [0, 2], volume: 1.0}
hoppers:
  - {name: truck, box: [8, -1.5, 13, 1.5], top: 2.0, time: [0, 600]}
  - {name: crusher, box: [14, -1, 15, 1], top: 1}
'''
# What snapshot_fuzz.cc has, too.
MOVING = '''soil: {repose_angle: 0.61, swell: 0.25}
pours:
  - {name: truck, at: [0.5, 0.5, 1], time: [0, 1.5], volume: 0.05}
  - {name: tip, at: [1, 0, 1], time: [1, 1], volume: 0.02}
hoppers:
  - {name: bed, box: [2, -1, 3, 1], top: 0.5}
'''
POSES = 'time,x,y,z,pitch\n0,0,0,0.1,0\n0.5,0.3,0,-0.1,0.1\n1,0.6,0,-0.1,0.2\n1.5,0.8,0,0.2,0.5\n'
QUATERNIONS = 'time,x,y,z,qx,qy,qz,qw,note\n0,1,2,3,0,0,0,1,"a, b"\n1e-3,2,2,3,0.6,0,0,0.8,\n'
JOINTS = '\ufefftime , boom,stick\r\n0,0.1,1\r\n1,0.5,+1.5\r\n2,1.5,-.5e0\r\n\r\n'
DRIVES = 'time,boom,stick,base_x,base_y,base_z,base_yaw\n0,0.1,1,5e5,0,1,0\n1,0.5,1.5,500001,0,1,0.3\n'
MACHINE = '''<?xml version="1.0"?>
<robot name="m">
  <!-- four links -->
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="boom"><visual><origin xyz="0 0 1"/><geometry><box size="1 1 2"/></geometry>
    <material name="grey"/></visual></link>
  <link name="stick"><collision><geometry><cylinder radius="1" length="2"/></geometry>
    </collision></link>
  <link name="bucket"><visual><geometry><mesh filename="package://m/b.dae" scale="1 1 1"/>
    </geometry></visual></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="boom"/>
    <axis xyz="0 0 1"/></joint>
  <joint name="lift" type="revolute"><parent link="boom"/><child link="stick"/>
    <origin xyz="0 0 1" rpy="0 1.57 0"/><axis xyz="0 3 4"/>
    <limit lower="-1" upper="1.5" effort="1" velocity="1"/><dynamics damping="1"/></joint>
  <joint name="end" type="fixed"><parent link="stick"/><child link="bucket"/></joint>
</robot>
'''


def write(target, name, content):
  folder = CORPUS / target
  folder.mkdir(parents=True, exist_ok=True)
  (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())


def rasters(work):
  """One of each format; see raster_fuzz.cc for how its parts are put together."""
  ascii_grid = ('ncols 3\nnrows 2\nxllcorner 500000\nyllcorner 5400000\ncellsize 1\n'
                'NODATA_value -9999\n1 2 3\n4 -9999 6.5\n')
  source = work / 'a.asc'
  source.write_text(ascii_grid)
  formats = [(0, 'GTiff', 'tif', None, ['-a_srs', 'EPSG:32632']),
             (0, 'GTiff', 'tif', None, ['-co', 'COMPRESS=DEFLATE', '-co', 'PREDICTOR=3']),
             (0, 'GTiff', 'tif', None, ['-co', 'COMPRESS=LZW', '-co', 'TILED=YES', '-ot', 'Int16']),
             (1, 'AAIGrid', 'asc', 'prj', ['-a_srs', 'EPSG:32632']),
             (2, 'EHdr', 'bil', 'hdr', []), (3, 'HFA', 'img', None, []),
             (4, 'ENVI', 'dat', 'hdr', []), (5, 'GSAG', 'grd', None, []),
             (5, 'GSBG', 'grd', None, []), (5, 'GS7BG', 'grd', None, []),
             (7, 'SAGA', 'sdat', 'sgrd', []),
             (8, 'DTED', 'dt0', None, ['-outsize', '121', '121', '-ot', 'Int16', '-a_srs', 'EPSG:4326',
                                       '-a_ullr', '5.9958333333', '46.0041666667', '7.0041666667',
                                       '44.9958333333']),
             (9, 'USGSDEM', 'dem', None, ['-ot', 'Int16', '-a_srs', 'EPSG:26911'])]
  for number, (choice, driver, suffix, header, options) in enumerate(formats):
    out = work / f'b{number}.{suffix}'
    subprocess.run(['gdal_translate', '-q', '-of', driver, *options, source, out], check=True)
    content = bytes([choice])
    if header:
      side = out.with_suffix('.' + header).read_bytes()
      content += struct.pack('<H', len(side)) + side
    write('raster', f'{driver.lower()}_{number}', content + out.read_bytes())


def tins():
  """A pit by two surfaces in LandXML, and faces of each kind in DXF; see tin_fuzz.cc."""
  points = ['0 0 5', '0 20 5', '20 20 5', '20 0 5', '10 10 0']
  faces = ['1 2 5', '2 3 5', '3 4 5', '4 1 5']

  def surface(name):
    return (f'<Surface name="{name}"><Definition surfType="TIN"><Pnts>'
            + ''.join(f'<P id="{n + 1}">{p}</P>' for n, p in enumerate(points)) + '</Pnts><Faces>'
            + ''.join(f'<F{" i=" + chr(34) + "1" + chr(34) if n == 3 else ""}>{f}</F>' for n, f in enumerate(faces))
            + '</Faces></Definition></Surface>')

  def landxml(units, crs, surfaces):
    return ('<?xml version="1.0"?>\n<LandXML xmlns="http://www.landxml.org/schema/LandXML-1.2" version="1.2">\n'
            f'<Units>{units}</Units>{crs}\n<Surfaces>{surfaces}</Surfaces></LandXML>\n')
  metric = '<Metric linearUnit="meter"/>'
  crs = '<CoordinateSystem epsgCode="2227"/>'
  write('tin', 'metres', '\0' + landxml(metric, '', surface('pit')))
  write('tin', 'feet', '\0' + landxml('<Imperial linearUnit="USSurveyFoot" elevationUnit="feet"/>', crs,
                                      surface('pit')))
  write('tin', 'two', '\0' + landxml(metric, '', surface('pit') + surface('a &amp; b')))

  def groups(*pairs):
    return ''.join(f'{code}\n{value}\n' for code, value in pairs)

  def corners(*places):
    return [(10 * axis + 10 + n, v) for n, place in enumerate(places) for axis, v in enumerate(place)]

  def vertex(place, flags, *more):
    return [(0, 'VERTEX'), (8, 'mesh'), *corners(place), (70, flags), *more]
  square = [(0, 0, 1), (9, 0, 2), (9, 9, 3), (0, 9, 7)]
  header = [(0, 'SECTION'), (2, 'HEADER'), (9, '$INSUNITS'), (70, 2), (0, 'ENDSEC')]
  three = [(0, '3DFACE'), (8, 'top'), *corners(*square[:3], square[2])]
  four = [(0, '3DFACE'), (8, 'top'), *corners(*square)]
  mesh = [(0, 'POLYLINE'), (8, 'mesh'), (66, 1), (70, 64), (71, 4), (72, 1),
          *(pair for place in square for pair in vertex(place, 192)),
          *vertex((0, 0, 0), 128, (71, 1), (72, 2), (73, 3), (74, 4)), (0, 'SEQEND')]
  for name, entities in {'dxf_faces': three + four, 'dxf_mesh': mesh, 'dxf_both': three + mesh}.items():
    write('tin', name, '\1' + groups(*header, (0, 'SECTION'), (2, 'ENTITIES'), *entities, (0, 'ENDSEC'),
                                     (0, 'EOF')))
  write('tin', 'dxf_lines', '\2' + groups(*header, (0, 'SECTION'), (2, 'ENTITIES'), (0, 'LINE'), (8, 'axis'),
                                         *corners((0, 0, 0), (9, 9, 1)), (0, 'ENDSEC'), (0, 'EOF')))
  write('tin', 'landxml_lines', '\4' + landxml(metric, crs, '').replace('<Surfaces></Surfaces>', (
    '<CgPoints><CgPoint name="a">0 100</CgPoint></CgPoints><Alignments><Alignment name="axis" staStart="10"><CoordGeom>'
    '<Line><Start>0 0</Start><End pntRef="a"/></Line>'
    '<Curve rot="ccw"><Start>0 100</Start><Center>50 100</Center><End>50 150</End></Curve>'
    '<Spiral length="30" radiusStart="50" radiusEnd="INF" rot="ccw" spiType="clothoid"><Start>50 150</Start>'
    '<PI>60.0865 150</PI><End>79.2841 144.0615</End></Spiral>'
    '<IrregularLine><Start>80 147</Start><End>90 147</End><PntList3D>85 148 1</PntList3D></IrregularLine></CoordGeom>'
    '<Profile><ProfAlign name="p"><PVI>10 1</PVI><ParaCurve length="20">50 2</ParaCurve>'
    '<CircCurve radius="500">90 1</CircCurve><PVI>200 2</PVI></ProfAlign></Profile></Alignment></Alignments>')))
  write('tin', 'geojson_lines', '\3' + json.dumps({
    'type': 'FeatureCollection', 'crs': {'type': 'name', 'properties': {'name': 'EPSG:32632'}},
    'features': [{'type': 'Feature', 'properties': {}, 'geometry': {'type': kind, 'coordinates': places}}
                 for kind, places in (('LineString', [[5e5, 5e6], [5e5, 5000009.5]]),
                                      ('Polygon', [[[5e5, 5e6, 1], [500009, 5e6, 2], [5e5, 5000009, 3], [5e5, 5e6, 1]]]))]}))


def mcaps(work):
  """Motions by joints, poses and transforms in one file, packed in each way."""
  pose = 'time,x,y,z,qx,qy,qz,qw\n'
  motions = {'j': 'time,wheel,boom,stick\n0.5,7,0.1,1\n1,7,0.25,1.5\n2.5,7,-0.5,0.5\n',
             'p': pose + '0.5,1,2,3,0,0,0,1\n1.25,2,2,3,0,0.6,0,0.8\n2,3,2,3,0,0,0,1\n',
             'b': pose + '0,0,0,0,0,0,0,1\n1.5,1,0,0,0,0,0,1\n3,2,0,0,0,0,0,1\n',
             's': pose + '0,0,0,1,0,0,0.6,0.8\n'}
  for name, text in motions.items():
    (work / f'{name}.csv').write_text(text)
  topics = ['joints:/j:j.csv', 'pose:/p:p.csv', 'tf:/tf:map:base:b.csv', 'tf:/tf_static:base:stick:s.csv',
            'tf:/tf:stick:lip:p.csv']
  for name, how in [('plain', []), ('big_endian', ['--big-endian', '--idl', '--no-crc', '--no-summary']),
                    ('chunks', ['--chunk', '4', '--no-crc']),
                    ('zstd', ['--chunk', '20', '--compression', 'zstd', '--no-crc']),
                    ('lz4', ['--chunk', '20', '--compression', 'lz4'])]:
    subprocess.run([sys.executable, HERE.parent / 'mcap/make_mcap.py', 'm.mcap', *how, *topics], cwd=work,
                   check=True)
    write('mcap', name, (work / 'm.mcap').read_bytes())


def scans(work):
  """Messages of scans, and recordings of them; see scans_fuzz.cc for the first byte."""
  sys.path.insert(0, str(HERE.parent / 'mcap'))
  import make_mcap
  for kind, row in [('cloud', {'x': '1', 'y': '2', 'z': '3'}), ('depth', {'mm': '1500'}),
                    ('camera', {'f': '500', 'c': '0.5'})]:
    for big_endian in (False, True):
      message = make_mcap.message_of(kind, ['lidar'], {'time': '1.5', **row}, big_endian)[1]
      write('scans', kind + '_big' * big_endian, kind[:2].encode() + message)
  rows = {'c': 'time,x,y,z\n1.5,1,2,0.3\n2.25,-4,5,6\n', 'd': 'time,mm\n1.5,1000\n2.25,500\n',
          'i': 'time,f,c\n1,500,1\n',
          't': 'time,x,y,z,qx,qy,qz,qw\n1,1,0,0,0,0,0,1\n2,2,0,0,0,0.6,0,0.8\n3,3,0,0,0,0,0,1\n'}
  for name, text in rows.items():
    (work / f'{name}.csv').write_text(text)
  topics = ['cloud:/points:lidar:c.csv', 'camera:/camera_info:lidar:i.csv',
            'depth:/depth:lidar:d.csv', 'tf:/tf:map:base:t.csv', 'tf:/tf_static:base:lidar:t.csv']
  for name, how in [('plain', []), ('chunks', ['--chunk', '3'])]:
    subprocess.run([sys.executable, HERE.parent / 'mcap/make_mcap.py', 's.mcap', *how, '--no-crc',
                    '--no-summary', *topics], cwd=work, check=True)
    write('scans', name, b'mc' + (work / 's.mcap').read_bytes())


def points():
  """A scan of each format, in each way to pack it."""
  xyz = [(1.0, 2.0, 3.0), (0.0, 0.0, 0.0), (-4.0, 5.5, 0.25)]
  rows = b''.join(struct.pack('<fff', *p) for p in xyz)
  header = ('ply\nformat {} 1.0\ncomment {}\nelement head 1\nproperty list uchar short l\n'
            'element vertex 3\nproperty float x\nproperty float y\nproperty float z\n'
            'element face 1\nproperty list uchar int vertex_indices\nend_header\n')
  write('points', 'ply_text', header.format('ascii', 'text') + '2 7 8\n1 2 3\n0 0 0\n-4 5.5 .25\n3 0 1 2\n')
  for order, name in [('<', 'little'), ('>', 'big')]:
    data = struct.pack(order + 'Bhh', 2, 7, 8) + b''.join(struct.pack(order + 'fff', *p) for p in xyz)
    write('points', 'ply_' + name, header.format(f'binary_{name}_endian', name).encode() + data)
  head = ('# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z _ rgb\nSIZE 4 4 4 1 4\n'
          'TYPE F F F U U\nCOUNT 1 1 1 2 1\nWIDTH 3\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 3\nDATA ')
  write('points', 'pcd_text', head + 'ascii\n1 2 3 0 0 9\nnan nan nan 0 0 9\n-4 5.5 .25 0 0 9\n')
  write('points', 'pcd_binary', head.encode() + b'binary\n' +
        b''.join(struct.pack('<fff2sI', *p, b'__', 9) for p in xyz))
  columns = struct.pack('<9f3I', *(p[k] for k in range(3) for p in xyz), 9, 9, 9)
  block = bytes([31]) + columns[:32] + bytes([7]) + columns[32:40] + b'\xC0\x03'  # ends with a copy
  write('points', 'pcd_compressed', head.encode() + b'binary_compressed\n' +
        struct.pack('<II', len(block), len(columns)) + block)
  for minor, form, size, record in [(2, 3, 227, 34), (4, 7, 375, 36)]:
    las = struct.pack('<4s20xBB68xHIIBHI20xdddddd', b'LASF', 1, minor, size, size, 0, form, record,
                      2 if minor < 4 else 0, 0.01, 0.01, 0.01, 5e5, 5.4e6, 1e2)
    las = las.ljust(247, b'\0')[:size] + (struct.pack('<Q', 2) if minor == 4 else b'')
    las = las.ljust(size, b'\0')
    las += b''.join(struct.pack('<iii', *p).ljust(record, b'r') for p in [(1, 2, 3), (0, 0, 0)])
    write('points', f'las_1_{minor}', las)
  write('points', 'text', '# x y z\n1 2 3 255\n0 0 0 0\n-4e0\t5.5 +.25 9\n')
  write('points', 'csv', 'time,Z,"X",y\n0.5,3,1,2\n1.5,nan,nan,nan\n')
  write('points', 'pts', '2\n1 2 3 9 1 2 3\n4 5 6 9 4 5 6\n')


def live_scans():
  """Messages of a live site's stream /scan."""
  def message(name, head, points):
    head = json.dumps(head).encode()
    write('live_scan', name, struct.pack('<I', len(head)) + head + points)
  place = {'position': [0, 0, 4], 'rotation': [1, 0, 0, 0], 'noise': {'range': 0.01}, 'mount': {'tilt': 0.001}}
  down = [(0.1 * i, 0.1 * j, 4.3) for i in range(4) for j in range(4)]
  floats = b''.join(struct.pack('<3f', *p) for p in down)
  message('points', {'sensor': 'mast', 'time': 1.5, 'format': 'float32_xyz', 'frame': 'sensor'}, floats)
  message('world', {'format': 'float64_xyz', 'frame': 'world', **place},
          b''.join(struct.pack('<3d', x, y, -0.3) for x, y, _ in down))
  message('depth', {'sensor': 'mast', 'format': 'depth_float32', 'shape': [4, 4],
                    'intrinsics': [40, 40, 1.5, 1.5]}, struct.pack('<16f', *[4.3] * 16))
  message('carried', {'sensor': 'bucket', 'format': 'float32_xyz', 'noise': 'ouster_os1'}, floats)
  fields = b''.join(struct.pack('<I2sxxIBxxxI', 2, name, 4 * k, 7, 1) for k, name in enumerate([b'x', b'y', b'z']))
  message('cloud', {'sensor': 'mast', 'format': 'cdr', 'type': 'sensor_msgs/msg/PointCloud2'},
          b'\0\1\0\0' + struct.pack('<iII2sxxIII', 1, 0, 2, b'm', 1, len(down), 3) + fields +
          struct.pack('<BxxxIII', 0, 12, len(floats), len(floats)) + floats + b'\1')


def with_directives(text):
  """Names and numbers as directives of printf: text of a file must never be a format."""
  return re.sub(r'\b(grey|boom|turn|pit|digger|0\.5|1\.5)\b', '%s%n%1$s', text)


def main():
  program = pathlib.Path(sys.argv[1]).resolve()
  write('scenario', 'poses', SCENARIO)
  write('scenario', 'joints', BY_JOINTS)
  write('scenario', 'earthmoving', EARTHMOVING)
  write('motion', 'poses', POSES)
  write('motion', 'quaternions', QUATERNIONS)
  write('motion', 'joints', JOINTS)
  write('motion', 'drives', DRIVES)
  write('urdf', 'machine', MACHINE)
  points()
  live_scans()
  for target, text in [('scenario', SCENARIO), ('motion', JOINTS), ('urdf', MACHINE)]:
    write(target, 'directives', with_directives(text))
  with tempfile.TemporaryDirectory() as folder:
    work = pathlib.Path(folder)
    rasters(work)
    tins()
    mcaps(work)
    scans(work)
    # The bucket that snapshot_fuzz.cc has, digging and in the air.
    rigid = re.sub(', profile: .*]]', '', SCENARIO)
    moving = re.sub(', dump_angle: [^}]*', '', SCENARIO) + MOVING
    for name, scenario, motion in [('moving', moving, POSES), ('digging', rigid, POSES),
                                   ('in_air', rigid, POSES.replace('-', ''))]:
      (work / 'scenario.yaml').write_text(scenario)
      (work / 'motion.csv').write_text(motion)
      subprocess.run([program, 'run', 'scenario.yaml', '--out', name], cwd=work, check=True,
                     stdout=subprocess.DEVNULL)
      write('journal', name, (work / name / 'journal').read_bytes())
      snapshot = (work / name / 'soil_final.vdb').read_bytes()
      size = int(snapshot[-65:-49], 16)  # in the line before the checksum's
      state = snapshot[-79 - size:-79]
      # A last byte says whether soil that moves is at rest.
      write('snapshot', name, b'M' + state[:-1] if name == 'moving' else b'\2' + state)
      rest = snapshot[:-79 - size]
      size = int(rest[-17:-1], 16)  # in the line behind the samples
      write('snapshot', 'samples_' + name, b'\3' + rest[-33 - size:-33])
  write('snapshot', 'no_state', b'\1soilvdb-state 0000000000000000\n')
  write('snapshot', 'file', b'\0' + snapshot[:200] + snapshot[-48:])
  points = b''.join(struct.pack('<fff', *p) for p in [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)])
  write('mesh', 'tetrahedron', b'\3\3' + struct.pack('<ddd', 5e5, 5.4e6, 100) + points +
        bytes([0, 2, 1, 0, 1, 3, 1, 2, 3, 0, 3, 2]) + b'PROJCRS["WGS 84 / UTM zone 32N"]')


main()
