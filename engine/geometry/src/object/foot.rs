//! The flat foot of a scan.
//!
//! parry touches with the first four corners of a hull's face only. A base of many corners, or of many nearly level triangles, therefore
//! stands on a sliver that changes from step to step, and a bottle on it rocks ever wider until it falls. A foot of four corners
//! inside the base is what such a thing stands on instead.

use super::piece::LabelledPiece;
use super::scanned::hull_piece;
use crate::mesh::TriMesh;
use nalgebra::{Point2, Point3};

/// Corners no higher than this above the lowest one belong to the base, metres: scans are uneven by as much.
const EVEN_M: f64 = 1.5e-3;
/// Height of the foot, metres.
const HEIGHT_M: f64 = 5e-3;
/// Its upper side is this much smaller, so that it lies inside hulls that narrow upwards.
const TAPER: f64 = 0.8;
/// Things with a smaller base stand on a point or an edge, square metres.
const MIN_AREA_M2: f64 = 1e-4;

/// The feet of convex groups that stand on the table.
pub(super) fn feet(groups: &[TriMesh]) -> Vec<LabelledPiece> {
    let low = |group: &TriMesh| group.vertices.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let table = groups.iter().map(low).fold(f64::INFINITY, f64::min);
    groups.iter().filter(|group| low(group) <= table + EVEN_M).filter_map(|group| foot(&group.vertices)).collect()
}

/// A foot for one convex group; `None` for what does not stand on an area.
fn foot(corners: &[Point3<f64>]) -> Option<LabelledPiece> {
    let low = corners.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
    let base: Vec<Point2<f64>> = corners.iter().filter(|p| p.z <= low + EVEN_M).map(Point3::xy).collect();
    let quad = widest_quad(&base)?;
    let middle = Point2::from(quad.iter().map(|p| p.coords).sum::<nalgebra::Vector2<f64>>() / 4.0);
    let at = |p: Point2<f64>, z: f64| Point3::new(p.x, p.y, z);
    let upper = quad.map(|p| at(middle + (p - middle) * TAPER, low + HEIGHT_M));
    let lower = quad.map(|p| at(p, low));
    Some(hull_piece(&[lower, upper].concat()))
}

/// The two points farthest from each other and the farthest on either side of their line.
fn widest_quad(points: &[Point2<f64>]) -> Option<[Point2<f64>; 4]> {
    let pairs = points.iter().enumerate().flat_map(|(i, a)| points[i + 1..].iter().map(move |b| (*a, *b)));
    let (a, b) = pairs.max_by(|p, q| (p.1 - p.0).norm_squared().total_cmp(&(q.1 - q.0).norm_squared()))?;
    let side = |p: &&Point2<f64>| (b - a).perp(&(**p - a));
    let left = *points.iter().max_by(|p, q| side(p).total_cmp(&side(q)))?;
    let right = *points.iter().min_by(|p, q| side(p).total_cmp(&side(q)))?;
    let area_m2 = (side(&&left) - side(&&right)) / 2.0;
    (area_m2 >= MIN_AREA_M2).then_some([a, right, b, left])
}

#[cfg(test)]
mod tests {
    #![expect(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use crate::Piece;

    fn ring(n: usize, radius_m: f64, z: f64) -> impl Iterator<Item = Point3<f64>> {
        (0..n).map(move |i| {
            let (sin, cos) = (std::f64::consts::TAU * i as f64 / n as f64).sin_cos();
            Point3::new(1.5 * radius_m * cos, radius_m * sin, z)
        })
    }

    #[test]
    fn a_base_of_many_corners_gets_four_as_wide_as_it_is() {
        let corners: Vec<_> = ring(48, 0.03, 0.0).chain(ring(48, 0.03, 0.1)).collect();
        let foot = foot(&corners).unwrap();
        let Piece::ConvexHull { points } = &foot.piece else { panic!("{foot:?}") };
        assert_eq!(points.len(), 8);
        let lower: Vec<_> = points.iter().map(|p| foot.object_from_piece * p).filter(|p| p.z < 1e-9).collect();
        assert_eq!(lower.len(), 4);
        let reach = |k: usize| lower.iter().map(|p| p[k]).fold(0.0, f64::max);
        assert!((reach(0) - 0.045).abs() < 1e-9 && (reach(1) - 0.03).abs() < 1e-9, "{lower:?}");
    }

    #[test]
    fn what_stands_on_a_point_has_no_foot() {
        let cone: Vec<_> = std::iter::once(Point3::origin()).chain(ring(24, 0.03, 0.05)).collect();
        assert!(foot(&cone).is_none());
        assert!(foot(&[]).is_none());
    }
}
