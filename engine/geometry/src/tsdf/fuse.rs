//! Projective fusion of depth views.

use sfg_types::tsdf::{EDGE, TRUNCATION_M, VOXEL_M};
use sfg_types::{Point, RgbdImage, Tsdf};

/// One view to be fused.
#[derive(Clone, Copy, Debug)]
pub struct TsdfView<'a> {
    /// Depth with calibration.
    pub image: &'a RgbdImage,
    /// `height * width`, row-major, not 0 on the object; `None` when every pixel shows it.
    pub object_mask: Option<&'a [u8]>,
}

/// Beyond one voxel in front of or behind the seen surface, in truncations, noise cannot change the sign.
const CLEAR: f32 = (VOXEL_M / TRUNCATION_M) as f32;

/// Sums over the views of one voxel: clearly in front of the surface, near it, clearly behind it.
#[derive(Clone, Copy, Default)]
struct Evidence {
    front: (f32, f32),
    near: (f32, f32),
    behind: (f32, f32),
}

/// The object's truncated signed distance in the cube centred on `centre_in_base`, axes along the base frame.
///
/// A voxel compares its depth along the camera axis with that of the pixel it falls on (nearest pixel):
///
/// | pixel | measured - own depth | evidence |
/// |---|---|---|
/// | object | > -truncation | signed distance, cut at +1 truncation |
/// | object | below | none: too far behind the surface |
/// | other | > one voxel | free space: +1 |
/// | other | else | none: the table and things in front hide the voxel and are never the object's surface |
/// | no return | | none |
///
/// The value is the mean over the views, except that "clearly behind a surface" only means hidden: when another view looks
/// through the voxel, that view decides. So a thin wall seen from both sides and a silhouette carved by the second view stay.
/// Voxels without evidence, such as those under the object and inside the table, stay unobserved (weight 0, distance 1).
///
/// # Panics
/// If a mask and its image differ in size; both come from one camera frame.
///
/// # Source
/// Curless and Levoy, SIGGRAPH 1996; the mean of equal weights and the rule for hidden voxels are ours.
#[must_use]
pub fn fuse_views(centre_in_base: &Point, views: &[TsdfView<'_>]) -> Tsdf {
    let mut tsdf = Tsdf::unobserved(centre_in_base);
    let prepared: Vec<Prepared<'_>> = views.iter().map(|view| Prepared::new(view, &tsdf)).collect();
    let mut row = [Evidence::default(); EDGE];
    for k in 0..EDGE {
        for j in 0..EDGE {
            row.fill(Evidence::default());
            for view in &prepared {
                view.collect(j, k, &mut row);
            }
            let start = Tsdf::index(0, j, k);
            for (i, evidence) in row.iter().enumerate() {
                if let Some((distance, weight)) = evidence.result() {
                    tsdf.distances[start + i] = distance;
                    tsdf.weights[start + i] = weight;
                }
            }
        }
    }
    tsdf
}

impl Evidence {
    fn add(&mut self, distance: f32) {
        let slot = if distance > CLEAR {
            &mut self.front
        } else if distance < -CLEAR {
            &mut self.behind
        } else {
            &mut self.near
        };
        slot.0 += distance;
        slot.1 += 1.0;
    }

    fn result(&self) -> Option<(f32, f32)> {
        let weight = self.front.1 + self.near.1 + self.behind.1;
        if weight == 0.0 {
            return None;
        }
        let hidden = if self.front.1 > 0.0 { (0.0, 0.0) } else { self.behind };
        let (sum, n) = (self.front.0 + self.near.0 + hidden.0, self.front.1 + self.near.1 + hidden.1);
        Some((sum / n, weight))
    }
}

/// A view with everything that is the same for all voxels.
struct Prepared<'a> {
    depth_m: &'a [f32],
    mask: Option<&'a [u8]>,
    width: usize,
    height: usize,
    focal: [f32; 2],
    /// Principal point plus one half, so that truncation picks the nearest pixel.
    centre: [f32; 2],
    /// Camera-frame centre of voxel (0, 0, 0) and the steps to its neighbours along x, y, z.
    first: [f32; 3],
    steps: [[f32; 3]; 3],
}

impl<'a> Prepared<'a> {
    fn new(view: &TsdfView<'a>, tsdf: &Tsdf) -> Self {
        let image = view.image;
        let camera = image.intrinsics;
        assert_eq!(image.depth_m.len(), camera.width * camera.height, "depth has the size of its image");
        if let Some(mask) = view.object_mask {
            assert_eq!(mask.len(), image.depth_m.len(), "mask and depth belong to one image");
        }
        let camera_from_base = image.base_from_camera.inverse();
        let voxel = |i, j, k| camera_from_base * tsdf.centre_in_base(i, j, k);
        let first = voxel(0, 0, 0);
        let step = |p: Point| (p - first).cast::<f32>().into();
        Self {
            depth_m: &image.depth_m,
            mask: view.object_mask,
            width: camera.width,
            height: camera.height,
            focal: [camera.fx as f32, camera.fy as f32],
            centre: [camera.cx as f32 + 0.5, camera.cy as f32 + 0.5],
            first: first.coords.cast::<f32>().into(),
            steps: [step(voxel(1, 0, 0)), step(voxel(0, 1, 0)), step(voxel(0, 0, 1))],
        }
    }

    fn collect(&self, j: usize, k: usize, row: &mut [Evidence; EDGE]) {
        const NEAREST_M: f32 = 0.05;
        let start: [f32; 3] =
            std::array::from_fn(|axis| self.first[axis] + self.steps[1][axis] * j as f32 + self.steps[2][axis] * k as f32);
        for (i, evidence) in row.iter_mut().enumerate() {
            let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| start[axis] + self.steps[0][axis] * i as f32);
            if z < NEAREST_M {
                continue;
            }
            let column = self.focal[0] * x / z + self.centre[0];
            let line = self.focal[1] * y / z + self.centre[1];
            if !(column >= 0.0 && line >= 0.0 && column < self.width as f32 && line < self.height as f32) {
                continue;
            }
            let pixel = line as usize * self.width + column as usize;
            let depth = self.depth_m[pixel];
            if depth <= 0.0 {
                continue;
            }
            let ahead = (depth - z) / TRUNCATION_M as f32;
            if self.mask.is_none_or(|mask| mask[pixel] != 0) {
                if ahead > -1.0 {
                    evidence.add(ahead.min(1.0));
                }
            } else if ahead > CLEAR {
                evidence.add(1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tsdf::{distance_at, surface_points};
    use sfg_types::{CameraIntrinsics, Pose, Vector};

    const RADIUS_M: f64 = 0.06;

    fn centre() -> Point {
        Point::new(0.6, 0.1, 0.9)
    }

    /// A ball on black ground 0.5 m behind it, seen from `eye`.
    fn ball_from(eye: Point) -> (RgbdImage, Vec<u8>) {
        let intrinsics = CameraIntrinsics { width: 320, height: 240, fx: 230.0, fy: 230.0, cx: 159.5, cy: 119.5 };
        let back = nalgebra::UnitQuaternion::face_towards(&(centre() - eye), &-Vector::z());
        let base_from_camera = Pose::from_parts(eye.coords.into(), back);
        let ball = base_from_camera.inverse() * centre();
        let mut depth_m = vec![(ball.z + 0.5) as f32; 320 * 240];
        let mut mask = vec![0; 320 * 240];
        for row in 0..240 {
            for column in 0..320 {
                let ray = intrinsics.deproject(column as f64, row as f64, 1.0).coords;
                let (b, c) = (ray.dot(&ball.coords), ball.coords.norm_squared() - RADIUS_M * RADIUS_M);
                let root = b * b - ray.norm_squared() * c;
                if root > 0.0 {
                    depth_m[row * 320 + column] = ((b - root.sqrt()) / ray.norm_squared()) as f32;
                    mask[row * 320 + column] = 1;
                }
            }
        }
        let rgb = vec![0; 320 * 240 * 3];
        (RgbdImage { camera: "test".to_owned(), intrinsics, base_from_camera, rgb, depth_m }, mask)
    }

    fn fused(eyes: &[Point]) -> Tsdf {
        let seen: Vec<_> = eyes.iter().map(|&eye| ball_from(eye)).collect();
        let views: Vec<_> = seen.iter().map(|(image, mask)| TsdfView { image, object_mask: Some(mask) }).collect();
        fuse_views(&centre(), &views)
    }

    #[test]
    fn sign_agrees_with_the_exact_distance_where_observed() {
        let tsdf = fused(&[Point::new(0.1, 0.4, 1.3), Point::new(0.1, -0.4, 1.2)]);
        let (mut n_right, mut n_wrong) = (0, 0);
        for k in 0..EDGE {
            for j in 0..EDGE {
                for i in 0..EDGE {
                    let idx = Tsdf::index(i, j, k);
                    let exact = (tsdf.centre_in_base(i, j, k) - centre()).norm() - RADIUS_M;
                    // Behind the ball the depth of the far side is a guess: two views cannot see it.
                    if tsdf.weights[idx] > 0.0 && exact.abs() > VOXEL_M {
                        if (tsdf.distances[idx] > 0.0) == (exact > 0.0) { n_right += 1 } else { n_wrong += 1 }
                    }
                }
            }
        }
        assert!(n_right > 30_000 && n_wrong * 100 < n_right, "{n_right} right, {n_wrong} wrong");
    }

    #[test]
    fn surface_points_lie_on_the_ball_and_point_away_from_it() {
        let eyes = [Point::new(0.1, 0.4, 1.3), Point::new(0.1, -0.4, 1.2)];
        let points = surface_points(&fused(&eyes));
        assert!(points.len() > 300, "{} points", points.len());
        let mut errors: Vec<f64> = points.iter().map(|p| ((p.point_in_base - centre()).norm() - RADIUS_M).abs()).collect();
        errors.sort_by(f64::total_cmp);
        let median = errors[errors.len() / 2];
        assert!(median < 0.25 * VOXEL_M, "median error {median} m");
        let n_outward = points.iter().filter(|p| p.normal_in_base.dot(&(p.point_in_base - centre()).normalize()) > 0.8).count();
        assert!(n_outward * 10 > points.len() * 9, "{n_outward} of {} normals point outwards", points.len());
    }

    #[test]
    fn the_second_view_carves_what_the_first_one_hides() {
        let eye = Point::new(0.1, 0.1, 0.9);
        let behind = centre() - Vector::new(RADIUS_M - 0.012, 0.0, 0.0);
        assert!(distance_at(&fused(&[eye]), &behind).is_some_and(|d| d < 0.0), "just behind the near side");
        assert!(distance_at(&fused(&[eye]), &centre()).is_none(), "deep inside is unobserved");
        let side = Point::new(0.6, 0.7, 0.9);
        let far = centre() + Vector::new(0.075, 0.0, 0.0);
        assert!(distance_at(&fused(&[eye]), &far).is_none(), "hidden from the front");
        assert!(distance_at(&fused(&[eye, side]), &far).is_some_and(|d| d > 0.0), "seen free from the side");
    }

    #[test]
    fn a_view_without_object_pixels_gives_no_surface() {
        let (image, mask) = ball_from(Point::new(0.1, 0.1, 1.1));
        let nothing = vec![0; mask.len()];
        let tsdf = fuse_views(&centre(), &[TsdfView { image: &image, object_mask: Some(&nothing) }]);
        assert!(surface_points(&tsdf).is_empty());
    }
}
