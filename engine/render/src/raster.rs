//! The rasteriser: triangles set up once, drawn in horizontal bands in parallel, shaded where they stayed visible.

use crate::scene::{Finish, Frame, Item, NO_ID, Scene, Sphere};
use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;
use sfg_types::{CameraIntrinsics, Pose};

/// Rows of one band: the unit of parallel work.
const BAND_ROWS: usize = 16;
/// Surfaces nearer than this are cut.
const NEAR_M: f64 = 0.01;
/// No primitive.
const NOTHING: u32 = u32::MAX;

/// A triangle in the image: the half planes of its edges and its plane of inverse depth, linear in the pixel.
struct ScreenTriangle {
    /// `a * column + b * row + c >= 0` inside, for each edge.
    edges: [[f64; 3]; 3],
    /// Inverse depth `a * column + b * row + c`, 1/m.
    inverse_depth: [f64; 3],
    first_row: u32,
    last_row: u32,
    item: u32,
    triangle: u32,
}

/// A ball in the image.
struct ScreenSphere {
    centre: Point3<f64>,
    columns: [usize; 2],
    rows: [usize; 2],
    sphere: u32,
}

/// An item in the camera frame.
struct Placed {
    camera_from_mesh: Pose,
    rotation: Matrix3<f32>,
    vertices: Vec<Point3<f64>>,
}

struct Lights {
    /// Unit vectors towards the lights, camera frame, with their strengths.
    directions: [(Vector3<f32>, f32); 2],
    ambient: f32,
}

pub(crate) fn render(scene: &Scene<'_>, camera: &CameraIntrinsics, base_from_camera: &Pose) -> Frame {
    let (width, height) = (camera.width, camera.height);
    let camera_from_base = base_from_camera.inverse();
    // Camera-frame vertices of every item, then its triangles in the image.
    let placed: Vec<Placed> = scene
        .items
        .par_iter()
        .map(|item| {
            let camera_from_mesh = camera_from_base * item.base_from_mesh;
            let vertices = item.mesh.vertices.iter().map(|v| camera_from_mesh * v).collect();
            let rotation = camera_from_mesh.rotation.to_rotation_matrix().into_inner().cast();
            Placed { camera_from_mesh, rotation, vertices }
        })
        .collect();
    let triangles: Vec<ScreenTriangle> = scene
        .items
        .par_iter()
        .enumerate()
        .flat_map_iter(|(idx, item)| set_up(item, idx as u32, &placed[idx].vertices, camera))
        .collect();
    let spheres: Vec<ScreenSphere> = scene
        .spheres
        .iter()
        .enumerate()
        .filter_map(|(idx, sphere)| set_up_sphere(sphere, idx as u32, &camera_from_base, camera))
        .collect();

    let n_bands = height.div_ceil(BAND_ROWS);
    let mut triangles_of_band: Vec<Vec<u32>> = vec![Vec::new(); n_bands];
    for (idx, t) in triangles.iter().enumerate() {
        for band in &mut triangles_of_band[t.first_row as usize / BAND_ROWS..=t.last_row as usize / BAND_ROWS] {
            band.push(idx as u32);
        }
    }

    let painter =
        Painter { scene, camera, placed: &placed, triangles: &triangles, spheres: &spheres, lights: lights(&camera_from_base) };
    let mut frame = Frame {
        width,
        height,
        rgb: vec![0; width * height * 3],
        depth_m: vec![0.0; width * height],
        instance_ids: vec![NO_ID; width * height],
        part_ids: vec![NO_ID; width * height],
    };
    let band_pixels = BAND_ROWS * width;
    frame
        .rgb
        .par_chunks_mut(band_pixels * 3)
        .zip(frame.depth_m.par_chunks_mut(band_pixels))
        .zip(frame.instance_ids.par_chunks_mut(band_pixels))
        .zip(frame.part_ids.par_chunks_mut(band_pixels))
        .zip(triangles_of_band.par_iter())
        .enumerate()
        .for_each(|(band, ((((rgb, depth_m), instance_ids), part_ids), members))| {
            painter.paint(band * BAND_ROWS, members, rgb, depth_m, instance_ids, part_ids);
        });
    frame
}

/// The visible triangles of one item.
fn set_up(item: &Item<'_>, item_idx: u32, vertices: &[Point3<f64>], camera: &CameraIntrinsics) -> Vec<ScreenTriangle> {
    let mut out = Vec::new();
    for (triangle_idx, t) in item.mesh.triangles.iter().enumerate() {
        let corners = t.map(|v| vertices[v as usize]);
        let normal = (corners[1] - corners[0]).cross(&(corners[2] - corners[0]));
        // The camera is at the origin: a normal along the line of sight is seen from behind.
        if item.mesh.closed && normal.dot(&corners[0].coords) >= 0.0 {
            continue;
        }
        let n_behind = corners.iter().filter(|p| p.z < NEAR_M).count();
        if n_behind == 3 {
            continue;
        }
        let mut push = |corners: [Point3<f64>; 3]| {
            out.extend(screen_triangle(&corners, &normal, camera).map(|mut s| {
                s.item = item_idx;
                s.triangle = triangle_idx as u32;
                s
            }));
        };
        if n_behind == 0 {
            push(corners);
        } else {
            let clipped = clip_near(&corners);
            for i in 1..clipped.len() - 1 {
                push([clipped[0], clipped[i], clipped[i + 1]]);
            }
        }
    }
    out
}

/// The part of a triangle in front of the near plane, a polygon of 3 or 4 corners.
fn clip_near(corners: &[Point3<f64>; 3]) -> Vec<Point3<f64>> {
    let mut out = Vec::with_capacity(4);
    for i in 0..3 {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        if p.z >= NEAR_M {
            out.push(p);
        }
        if (p.z >= NEAR_M) != (q.z >= NEAR_M) {
            out.push(p + (q - p) * ((NEAR_M - p.z) / (q.z - p.z)));
        }
    }
    out
}

fn screen_triangle(corners: &[Point3<f64>; 3], normal: &Vector3<f64>, camera: &CameraIntrinsics) -> Option<ScreenTriangle> {
    let image = corners.map(|p| [camera.fx * p.x / p.z + camera.cx, camera.fy * p.y / p.z + camera.cy]);
    let span = |axis: usize| {
        let values = image.map(|p| p[axis]);
        (values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2]))
    };
    let ((left, right), (top, bottom)) = (span(0), span(1));
    if right < 0.0 || bottom < 0.0 || left > (camera.width - 1) as f64 || top > (camera.height - 1) as f64 {
        return None;
    }
    let (first_row, last_row) = (top.ceil().max(0.0), bottom.floor().min((camera.height - 1) as f64));
    if first_row > last_row || left.ceil() > right.floor() {
        return None;
    }
    let cross = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
    let area = cross(image[0], image[1], image[2]);
    if area.abs() < 1e-12 {
        return None;
    }
    let sign = area.signum();
    let edges = std::array::from_fn(|i| {
        let (p, q) = (image[i], image[(i + 1) % 3]);
        let (a, b) = (-(q[1] - p[1]) * sign, (q[0] - p[0]) * sign);
        [a, b, -(a * p[0] + b * p[1])]
    });
    // The plane n.X = n.P seen along the ray (x, y, 1) z gives 1/z linear in the pixel.
    let offset = normal.dot(&corners[0].coords);
    if offset.abs() < 1e-15 {
        return None;
    }
    let (a, b) = (normal.x / camera.fx / offset, normal.y / camera.fy / offset);
    let inverse_depth = [a, b, normal.z / offset - a * camera.cx - b * camera.cy];
    Some(ScreenTriangle { edges, inverse_depth, first_row: first_row as u32, last_row: last_row as u32, item: 0, triangle: 0 })
}

fn set_up_sphere(sphere: &Sphere, idx: u32, camera_from_base: &Pose, camera: &CameraIntrinsics) -> Option<ScreenSphere> {
    let centre = camera_from_base * sphere.centre_in_base;
    let r = sphere.radius_m;
    if centre.z < NEAR_M + r {
        return None;
    }
    // The exact extent of the outline along one image axis: the two tangents from the camera in the (axis, z) plane.
    let span = |x: f64, focal: f64, middle: f64, n: usize| {
        let flat = x * x + centre.z * centre.z - r * r;
        let denominator = centre.z * centre.z - r * r;
        let root = r * flat.max(0.0).sqrt();
        let (low, high) = ((x * centre.z - root) / denominator, (x * centre.z + root) / denominator);
        let (low, high) = ((focal * low + middle).ceil().max(0.0), (focal * high + middle).floor().min((n - 1) as f64));
        (low <= high).then_some([low as usize, high as usize])
    };
    let columns = span(centre.x, camera.fx, camera.cx, camera.width)?;
    let rows = span(centre.y, camera.fy, camera.cy, camera.height)?;
    Some(ScreenSphere { centre, columns, rows, sphere: idx })
}

fn lights(camera_from_base: &Pose) -> Lights {
    let towards = |x: f64, y: f64, z: f64| (camera_from_base.rotation * Vector3::new(x, y, z).normalize()).cast::<f32>();
    Lights { directions: [(towards(-0.45, 0.55, 1.0), 0.60), (towards(-0.7, -0.8, 0.35), 0.34)], ambient: 0.34 }
}

struct Painter<'a> {
    scene: &'a Scene<'a>,
    camera: &'a CameraIntrinsics,
    placed: &'a [Placed],
    triangles: &'a [ScreenTriangle],
    spheres: &'a [ScreenSphere],
    lights: Lights,
}

impl Painter<'_> {
    fn paint(
        &self,
        first_row: usize,
        members: &[u32],
        rgb: &mut [u8],
        depth_m: &mut [f32],
        instance_ids: &mut [u16],
        part_ids: &mut [u16],
    ) {
        let width = self.camera.width;
        let n_rows = depth_m.len() / width;
        // Nearest so far: inverse depth, and the triangle, or beyond the triangles the ball.
        let mut nearest = vec![0.0_f64; depth_m.len()];
        let mut primitive = vec![NOTHING; depth_m.len()];
        for &idx in members {
            self.draw_triangle(idx, first_row, n_rows, &mut nearest, &mut primitive);
        }
        for (idx, sphere) in self.spheres.iter().enumerate() {
            let id = (self.triangles.len() + idx) as u32;
            self.draw_sphere(sphere, id, first_row, n_rows, &mut nearest, &mut primitive);
        }
        for pixel in 0..depth_m.len() {
            let colour = &mut rgb[pixel * 3..pixel * 3 + 3];
            if primitive[pixel] == NOTHING {
                colour.copy_from_slice(&self.scene.background);
                continue;
            }
            let depth = 1.0 / nearest[pixel];
            let (row, column) = (first_row + pixel / width, pixel % width);
            let point = self.camera.deproject(column as f64, row as f64, depth);
            let (shaded, instance_id, part_id) = self.shade(primitive[pixel] as usize, &point);
            colour.copy_from_slice(&shaded);
            depth_m[pixel] = depth as f32;
            instance_ids[pixel] = instance_id;
            part_ids[pixel] = part_id;
        }
    }

    fn draw_triangle(&self, idx: u32, first_row: usize, n_rows: usize, nearest: &mut [f64], primitive: &mut [u32]) {
        let width = self.camera.width;
        let t = &self.triangles[idx as usize];
        let rows = (t.first_row as usize).max(first_row)..(t.last_row as usize + 1).min(first_row + n_rows);
        for row in rows {
            let y = row as f64;
            let (mut left, mut right) = (0.0_f64, (width - 1) as f64);
            for [a, b, c] in t.edges {
                let rest = b * y + c;
                // A hair of overlap: neighbours share pixels on their edge instead of leaving a gap.
                if a > 0.0 {
                    left = left.max(-rest / a - 1e-7);
                } else if a < 0.0 {
                    right = right.min(-rest / a + 1e-7);
                } else if rest < -1e-7 {
                    right = -1.0;
                }
            }
            let (first, last) = (left.ceil(), right.floor());
            if first > last {
                continue;
            }
            let [a, b, c] = t.inverse_depth;
            let start = (row - first_row) * width;
            let span = start + first as usize..=start + last as usize;
            let base = b * y + c;
            for (offset, (near, prim)) in nearest[span.clone()].iter_mut().zip(&mut primitive[span]).enumerate() {
                let inverse = base + a * (first + offset as f64);
                if inverse > *near {
                    *near = inverse;
                    *prim = idx;
                }
            }
        }
    }

    fn draw_sphere(
        &self,
        sphere: &ScreenSphere,
        id: u32,
        first_row: usize,
        n_rows: usize,
        nearest: &mut [f64],
        primitive: &mut [u32],
    ) {
        let radius = self.scene.spheres[sphere.sphere as usize].radius_m;
        let c = sphere.centre.coords.norm_squared() - radius * radius;
        for row in sphere.rows[0].max(first_row)..(sphere.rows[1] + 1).min(first_row + n_rows) {
            for column in sphere.columns[0]..=sphere.columns[1] {
                let ray = self.camera.deproject(column as f64, row as f64, 1.0).coords;
                let (a, b) = (ray.norm_squared(), ray.dot(&sphere.centre.coords));
                let root = b * b - a * c;
                if root < 0.0 {
                    continue;
                }
                let inverse = a / (b - root.sqrt());
                let pixel = (row - first_row) * self.camera.width + column;
                if inverse > nearest[pixel] {
                    nearest[pixel] = inverse;
                    primitive[pixel] = id;
                }
            }
        }
    }

    fn shade(&self, primitive: usize, point: &Point3<f64>) -> ([u8; 3], u16, u16) {
        let Some(t) = self.triangles.get(primitive) else {
            let placed = &self.spheres[primitive - self.triangles.len()];
            let sphere = &self.scene.spheres[placed.sphere as usize];
            let normal = ((point - placed.centre) / sphere.radius_m).cast::<f32>();
            return (self.lights.apply(sphere.colour, &normal, 1.0), sphere.instance_id, sphere.part_id);
        };
        let item = &self.scene.items[t.item as usize];
        let placed = &self.placed[t.item as usize];
        let triangle = t.triangle as usize;
        let [p, q, r] = item.mesh.triangles[triangle].map(|v| placed.vertices[v as usize]);
        // Barycentric coordinates of the point on the original triangle.
        let (u, v, w) = (q - p, r - p, point - p);
        let (uu, uv, vv, wu, wv) = (u.dot(&u), u.dot(&v), v.dot(&v), w.dot(&u), w.dot(&v));
        let denominator = (uu * vv - uv * uv).max(1e-300);
        let (s, t_) = (((vv * wu - uv * wv) / denominator) as f32, ((uu * wv - uv * wu) / denominator) as f32);
        let [a, b, c] = &item.mesh.normals[triangle];
        let in_mesh = a * (1.0 - s - t_) + b * s + c * t_;
        let mut normal = placed.rotation * in_mesh;
        // Open meshes show both sides.
        if normal.dot(&point.coords.cast::<f32>()) > 0.0 && !item.mesh.closed {
            normal = -normal;
        }
        let normal = normal.try_normalize(1e-12).unwrap_or(normal);
        let colour = item.mesh.colours.get(triangle).copied().unwrap_or(item.colour);
        let tone = match item.finish {
            Finish::Plain => 1.0,
            finish => tone(finish, &placed.camera_from_mesh.inverse_transform_point(point)),
        };
        (self.lights.apply(colour, &normal, tone), item.instance_id, item.part_id)
    }
}

impl Lights {
    fn apply(&self, colour: [u8; 3], normal: &Vector3<f32>, tone: f32) -> [u8; 3] {
        let lit: f32 = self.directions.iter().map(|(towards, strength)| strength * normal.dot(towards).max(0.0)).sum();
        let light = (self.ambient + lit) * tone;
        colour.map(|c| (f32::from(c) * light + 0.5).clamp(0.0, 255.0) as u8)
    }
}

/// Brightness of a patterned surface at a point of its mesh.
fn tone(finish: Finish, p: &Point3<f64>) -> f32 {
    match finish {
        Finish::Plain => 1.0,
        Finish::Tiles => {
            let square = |x: f64| (x / 0.25).floor() as i64;
            if (square(p.x) + square(p.y)) % 2 == 0 { 1.0 } else { 0.94 }
        }
        Finish::Wood => {
            // Planks of 12 cm with a slow wave of grain along x.
            let plank = (p.y / 0.12).floor();
            let shade = plank * 0.618;
            let grain = wave(p.y * 67.0 + 0.35 * wave(p.x * 1.4 + plank * 0.27));
            let joint = if (p.y / 0.12 - plank) < 0.012 { 0.90 } else { 1.0 };
            ((0.965 + 0.045 * (shade - shade.floor()) + 0.012 * grain) * joint) as f32
        }
    }
}

/// A smooth wave of period 1 between -1 and 1; several times as fast as a sine, which counts at every pixel of a table.
fn wave(x: f64) -> f64 {
    let t = ((x - x.floor()) * 2.0 - 1.0).abs();
    2.0 * t * t * (3.0 - 2.0 * t) - 1.0
}
