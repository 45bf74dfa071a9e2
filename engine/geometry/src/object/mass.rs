//! Mass, centre of mass and inertia from a signed distance, by an octree that refines only at the surface.

use nalgebra::{Matrix3, Point3, Vector3};

/// How the mass of an object is spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MassProperties {
    /// Mass.
    pub mass_kg: f64,
    /// Centre of mass, metres.
    pub centre_of_mass_in_object: Point3<f64>,
    /// Inertia about the centre of mass along the object's axes.
    pub inertia_kg_m2: Matrix3<f64>,
    /// Volume of the solid material.
    pub volume_m3: f64,
}

#[derive(Default)]
struct Sums {
    volume: f64,
    mass: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

/// Integrates over the solid inside the cube about `centre`; `density` is relative and scaled so that the whole weighs `mass_kg`.
///
/// Cells of `leaf_m` that the surface crosses count by the share of the cell that a plane at this distance leaves inside.
pub(crate) fn integrate(
    distance: &dyn Fn(&Point3<f64>) -> f64,
    density: &dyn Fn(&Point3<f64>) -> f64,
    centre: &Point3<f64>,
    half_edge_m: f64,
    leaf_m: f64,
    mass_kg: f64,
) -> MassProperties {
    let mut sums = Sums::default();
    visit(distance, density, centre, half_edge_m, leaf_m, &mut sums);
    let scale = if sums.mass > 0.0 { mass_kg / sums.mass } else { 0.0 };
    let com = if sums.mass > 0.0 { sums.first / sums.mass } else { centre.coords };
    let about_com = (sums.second - com * com.transpose() * sums.mass) * scale;
    MassProperties {
        mass_kg,
        centre_of_mass_in_object: Point3::from(com),
        inertia_kg_m2: Matrix3::identity() * about_com.trace() - about_com,
        volume_m3: sums.volume,
    }
}

fn visit(
    distance: &dyn Fn(&Point3<f64>) -> f64,
    density: &dyn Fn(&Point3<f64>) -> f64,
    centre: &Point3<f64>,
    half: f64,
    leaf_m: f64,
    sums: &mut Sums,
) {
    let d = distance(centre);
    let reach = half * 3.0_f64.sqrt();
    if d > reach {
        return;
    }
    let leaf = 2.0 * half <= leaf_m;
    if d < -reach || leaf {
        let share = if leaf { (0.5 - d / (2.0 * half)).clamp(0.0, 1.0) } else { 1.0 };
        let volume = 8.0 * half.powi(3) * share;
        let mass = volume * density(centre);
        sums.volume += volume;
        sums.mass += mass;
        sums.first += centre.coords * mass;
        // A cube of edge 2h adds h^2 / 3 along each axis.
        sums.second += (centre.coords * centre.coords.transpose() + Matrix3::identity() * (half * half / 3.0)) * mass;
        return;
    }
    for octant in 0..8 {
        let sign = |bit: usize| if octant >> bit & 1 == 1 { half / 2.0 } else { -half / 2.0 };
        let child = centre + Vector3::new(sign(0), sign(1), sign(2));
        visit(distance, density, &child, half / 2.0, leaf_m, sums);
    }
}
