//! The errors of a stereo depth camera.

use crate::Frame;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use rayon::prelude::*;
use sfg_types::CameraIntrinsics;

/// How a depth camera errs. The default resembles an Intel RealSense D435i.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorNoise {
    /// Standard deviation of depth divided by depth squared, 1/m. Stereo: `subpixel / (focal_px * baseline_m)`; 0.05 px, 640 px
    /// and 50 mm (1280 x 720 depth mode) give 0.0016. The subpixel error is an assumption for textured, well lit scenes.
    pub sigma_per_m2: f64,
    /// Step of the depth values (the camera's default depth unit is 1 mm).
    pub step_m: f64,
    /// Nearest and furthest depth that returns.
    pub range_m: [f64; 2],
    /// Between these angles of the surface normal to the line of sight, returns fade out.
    pub grazing_rad: [f64; 2],
    /// A jump to a neighbouring pixel larger than this share of the depth is an edge.
    pub edge_share: f64,
    /// Share of edge pixels without return.
    pub edge_dropout: f64,
    /// Share of all other pixels without return.
    pub speckle_dropout: f64,
    /// Standard deviation of each colour value, of 255.
    pub colour_sigma: f64,
}

impl Default for SensorNoise {
    fn default() -> Self {
        Self {
            sigma_per_m2: 0.0016,
            step_m: 0.001,
            range_m: [0.15, 4.0],
            grazing_rad: [1.31, 1.48],
            edge_share: 0.03,
            edge_dropout: 0.5,
            speckle_dropout: 0.003,
            colour_sigma: 1.5,
        }
    }
}

impl SensorNoise {
    /// Turns the exact colours and depths of a frame into what the camera delivers. Identities stay exact.
    ///
    /// The same `(seed, frame_idx, camera_idx)` gives the same bytes. Errors of neighbouring pixels are independent, which a real
    /// stereo camera's are not: its patches of matching blur them together.
    pub fn apply(&self, frame: &mut Frame, camera: &CameraIntrinsics, seed: u64, frame_idx: u64, camera_idx: u64) {
        let mut key = [0; 32];
        for (slot, value) in key.chunks_exact_mut(8).zip([seed, frame_idx, camera_idx, 0x6d43_3544]) {
            slot.copy_from_slice(&value.to_le_bytes());
        }
        let exact = frame.depth_m.clone();
        let (width, height) = (frame.width, frame.height);
        let rows = frame.depth_m.par_chunks_mut(width).zip(frame.rgb.par_chunks_mut(width * 3)).enumerate();
        rows.for_each(|(row, (depths, colours))| {
            // Each row has its own stream: the same bytes at any number of threads.
            let mut rng = ChaCha8Rng::from_seed(key);
            rng.set_stream(row as u64);
            for (column, (measured, colour)) in depths.iter_mut().zip(colours.chunks_exact_mut(3)).enumerate() {
                let (normal, chance) = (normal_deviate(rng.next_u64()), unit(rng.next_u32()));
                let depth = f64::from(*measured);
                let keep = depth > 0.0
                    && (self.range_m[0]..=self.range_m[1]).contains(&depth)
                    && chance >= self.dropout(&exact, width, height, column, row, camera);
                let noisy = depth + normal * self.sigma_per_m2 * depth * depth;
                *measured = if keep { ((noisy / self.step_m).round() * self.step_m) as f32 } else { 0.0 };
                let bits = rng.next_u64();
                for (channel, value) in colour.iter_mut().enumerate() {
                    let deviate = triangular_deviate(bits >> (16 * channel));
                    *value = (f64::from(*value) + deviate * self.colour_sigma + 0.5).clamp(0.0, 255.0) as u8;
                }
            }
        });
    }

    /// Probability that a pixel returns nothing.
    fn dropout(&self, depth_m: &[f32], width: usize, height: usize, column: usize, row: usize, camera: &CameraIntrinsics) -> f64 {
        let at = |column: usize, row: usize| f64::from(depth_m[row * width + column]);
        let here = at(column, row);
        let (left, right) = (at(column.saturating_sub(1), row), at((column + 1).min(width - 1), row));
        let (above, below) = (at(column, row.saturating_sub(1)), at(column, (row + 1).min(height - 1)));
        let is_edge = [left, right, above, below].iter().any(|d| (d - here).abs() > self.edge_share * here);
        if is_edge {
            return self.edge_dropout;
        }
        // The slope of the depth gives the angle to the line of sight.
        let slope_x = (right - left) / 2.0 * camera.fx / here;
        let slope_y = (below - above) / 2.0 * camera.fy / here;
        let tangent = slope_x.hypot(slope_y);
        let [full, none] = self.grazing_rad.map(f64::tan);
        let grazing = ((tangent - full) / (none - full)).clamp(0.0, 1.0);
        grazing.max(self.speckle_dropout)
    }
}

/// A number in [0, 1).
fn unit(bits: u32) -> f64 {
    f64::from(bits) / 4_294_967_296.0
}

/// A deviate of mean 0 and deviation 1 from two bytes, triangular: rounding to whole colour values hides the difference.
fn triangular_deviate(bits: u64) -> f64 {
    ((bits & 0xff) as f64 + (bits >> 8 & 0xff) as f64 - 255.0) / 255.0 * 6.0_f64.sqrt()
}

/// A nearly normal deviate of mean 0 and deviation 1, cut at 3.46: the sum of four 16-bit uniforms. Unlike the usual transforms it
/// uses no library function whose last bit differs between machines.
fn normal_deviate(bits: u64) -> f64 {
    let sum: u64 = (0..4).map(|i| bits >> (16 * i) & 0xffff).sum();
    (sum as f64 / 65_535.0 - 2.0) * 3.0_f64.sqrt()
}
