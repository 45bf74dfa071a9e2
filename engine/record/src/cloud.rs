//! `/cloud`: the coloured points that a decision was taken on, base frame.

use crate::recording::timestamp;
use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{PackedElementField, PointCloud, Pose, Quaternion, Vector3};
use sfg_types::{Observation, Point};

/// Every so many columns and rows become a point.
const STEP_PX: usize = 6;
/// Bytes of a point: three floats and four colour bytes.
const STRIDE: u32 = 16;

/// The points of all views.
pub(crate) fn points(log_time_ns: u64, base: &str, observation: &Observation) -> PointCloud {
    let mut data = Vec::new();
    for view in &observation.views {
        let width = view.intrinsics.width;
        for (idx, depth_m) in view.depth_m.iter().enumerate() {
            let (column, row) = (idx % width, idx / width);
            let Some(colour) = view.rgb.get(3 * idx..3 * idx + 3) else { break };
            if column % STEP_PX != 0 || row % STEP_PX != 0 || *depth_m <= 0.0 {
                continue;
            }
            let point: Point = view.base_from_camera * view.intrinsics.deproject(column as f64, row as f64, f64::from(*depth_m));
            data.extend(point.iter().flat_map(|value| (*value as f32).to_le_bytes()));
            // Viewers read the bytes as red, green, blue, alpha by their names.
            data.extend_from_slice(colour);
            data.push(255);
        }
    }
    let field = |name: &str, offset, kind: NumericType| PackedElementField { name: name.to_owned(), offset, r#type: kind as i32 };
    PointCloud {
        timestamp: Some(timestamp(log_time_ns)),
        frame_id: base.to_owned(),
        pose: Some(Pose {
            position: Some(Vector3::default()),
            orientation: Some(Quaternion { w: 1.0, ..Quaternion::default() }),
        }),
        point_stride: STRIDE,
        fields: vec![
            field("x", 0, NumericType::Float32),
            field("y", 4, NumericType::Float32),
            field("z", 8, NumericType::Float32),
            field("red", 12, NumericType::Uint8),
            field("green", 13, NumericType::Uint8),
            field("blue", 14, NumericType::Uint8),
            field("alpha", 15, NumericType::Uint8),
        ],
        data: data.into(),
    }
}
