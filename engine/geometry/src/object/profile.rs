//! The half-plane outline of a lathe: exact distance, and the inner wall of a vessel.

/// An outline in the half plane (radius, height), counter-clockwise from the axis at the bottom back to the axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Profile {
    /// The boundary; its two ends lie on the axis.
    outline: Vec<[f64; 2]>,
    /// The outside, bottom to top, starting on the axis.
    outer: Vec<[f64; 2]>,
    /// For a vessel the inside, point for point beside `outer`.
    inner: Vec<[f64; 2]>,
    /// Wall thickness of a vessel.
    wall: f64,
}

impl Profile {
    /// A full body. Its profile must rise: that is what can be cut into convex slices.
    pub(crate) fn solid(profile: &[[f64; 2]]) -> Result<Self, String> {
        let outer = checked(profile)?;
        if outer.windows(2).any(|pair| pair[1][1] < pair[0][1]) {
            return Err("the profile of a solid lathe must not fall".to_owned());
        }
        let mut outline = outer.clone();
        let top = outer[outer.len() - 1];
        if top[0] > 0.0 {
            outline.push([0.0, top[1]]);
        }
        Ok(Self { outline, outer, inner: Vec::new(), wall: 0.0 })
    }

    /// A body open at the top whose walls and floor of thickness `wall` lie inside the profile.
    pub(crate) fn vessel(profile: &[[f64; 2]], wall: f64) -> Result<Self, String> {
        let outer = checked(profile)?;
        let n = outer.len();
        if n < 3 || outer[1][1] != outer[0][1] {
            return Err("a vessel needs a flat base: the first profile radius must be above 0".to_owned());
        }
        // Every segment moves inwards by the wall; neighbours meet where the moved lines cross.
        let line = |i: usize| {
            let (p, q) = (outer[i], outer[i + 1]);
            let length = (q[0] - p[0]).hypot(q[1] - p[1]);
            let t = [(q[0] - p[0]) / length, (q[1] - p[1]) / length];
            ([p[0] - t[1] * wall, p[1] + t[0] * wall], t)
        };
        let mut inner = vec![[0.0, outer[0][1] + wall]];
        for i in 1..n - 1 {
            let ((p, t), (q, u)) = (line(i - 1), line(i));
            let cross = t[0] * u[1] - t[1] * u[0];
            inner.push(if cross.abs() < 1e-6 {
                q
            } else {
                let s = ((q[0] - p[0]) * u[1] - (q[1] - p[1]) * u[0]) / cross;
                [p[0] + s * t[0], p[1] + s * t[1]]
            });
        }
        let (p, t) = line(n - 2);
        if t[1] < 0.2 {
            return Err("the last segment of a vessel's profile must rise".to_owned());
        }
        let top = outer[n - 1][1];
        inner.push([p[0] + (top - p[1]) / t[1] * t[0], top]);
        for (i, pair) in inner.windows(2).enumerate() {
            let outward = [outer[i + 1][0] - outer[i][0], outer[i + 1][1] - outer[i][1]];
            let along = (pair[1][0] - pair[0][0]) * outward[0] + (pair[1][1] - pair[0][1]) * outward[1];
            if along <= 0.0 || (pair[1][0] <= 0.0) {
                return Err(format!("a wall of {wall} m does not fit inside profile segment {i}"));
            }
        }
        let outline = outer.iter().chain(inner.iter().rev()).copied().collect();
        Ok(Self { outline, outer, inner, wall })
    }

    /// The outline, for turning into a mesh.
    pub(crate) fn outline(&self) -> &[[f64; 2]] {
        &self.outline
    }

    /// The outside, bottom to top, starting on the axis.
    pub(crate) fn outer(&self) -> &[[f64; 2]] {
        &self.outer
    }

    /// The inside of a vessel, bottom to top, starting on the axis.
    pub(crate) fn inner(&self) -> Option<&[[f64; 2]]> {
        (!self.inner.is_empty()).then_some(&self.inner)
    }

    /// Wall thickness; 0 for a solid.
    pub(crate) fn wall(&self) -> f64 {
        self.wall
    }

    /// Exact signed distance of the turned body at (radius, height).
    ///
    /// The nearest surface point of a body of revolution lies in the half plane of the query, so the plane distance is exact.
    pub(crate) fn signed_distance(&self, radius: f64, height: f64) -> f64 {
        let mut nearest = f64::INFINITY;
        let mut inside = false;
        for pair in self.outline.windows(2) {
            let (p, q) = (pair[0], pair[1]);
            let (dr, dz) = (q[0] - p[0], q[1] - p[1]);
            let (er, ez) = (radius - p[0], height - p[1]);
            let t = ((er * dr + ez * dz) / (dr * dr + dz * dz)).clamp(0.0, 1.0);
            let (fr, fz) = (er - t * dr, ez - t * dz);
            nearest = nearest.min(fr * fr + fz * fz);
            // A line outwards along +r crosses the boundary an odd number of times from inside; the axis is never met.
            if (p[1] > height) != (q[1] > height) && radius < p[0] + (height - p[1]) / dz * dr {
                inside = !inside;
            }
        }
        if inside { -nearest.sqrt() } else { nearest.sqrt() }
    }

    /// Largest radius, lowest and highest point.
    pub(crate) fn extent(&self) -> (f64, f64, f64) {
        self.outline.iter().fold((0.0, f64::INFINITY, f64::NEG_INFINITY), |(r, low, high): (f64, f64, f64), p| {
            (r.max(p[0]), low.min(p[1]), high.max(p[1]))
        })
    }
}

/// The profile, starting on the axis, without repeated points.
fn checked(profile: &[[f64; 2]]) -> Result<Vec<[f64; 2]>, String> {
    if let Some(p) = profile.iter().find(|p| !(p[0] >= 0.0 && p[0].is_finite() && p[1].is_finite())) {
        return Err(format!("profile point [{}, {}] is not finite with a radius of at least 0", p[0], p[1]));
    }
    let mut outer: Vec<[f64; 2]> = Vec::with_capacity(profile.len() + 1);
    if let Some(first) = profile.first().filter(|p| p[0] > 0.0) {
        outer.push([0.0, first[1]]);
    }
    for &point in profile {
        if outer.last().is_none_or(|last| (last[0] - point[0]).hypot(last[1] - point[1]) > 1e-6) {
            outer.push(point);
        }
    }
    if outer.len() < 2 {
        return Err(format!("a profile needs 2 different points, it has {}", profile.len()));
    }
    Ok(outer)
}
