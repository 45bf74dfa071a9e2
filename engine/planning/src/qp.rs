//! Small strictly convex quadratic programs, solved to the last digits by a dual active-set method.
//!
//! An interior-point solver takes ten times as long for seven variables and leaves errors of 1e-3 where the cost is flat; at every
//! control period of a robot neither will do.

use nalgebra::{Cholesky, DMatrix, DVector};

/// Minimise `1/2 x' H x + g' x` subject to `A x <= b`.
#[derive(Clone, Debug)]
pub struct QuadraticProgram {
    /// `H`, n x n, symmetric and positive definite; its lower triangle is read.
    pub hessian: DMatrix<f64>,
    /// `g`, n.
    pub gradient: DVector<f64>,
    /// `A`, m x n; rows of zeros are allowed.
    pub rows: DMatrix<f64>,
    /// `b`, m; infinite where a row does not bind.
    pub bounds: DVector<f64>,
}

/// The minimum.
#[derive(Clone, Debug, PartialEq)]
pub struct QpSolution {
    /// `x`, n.
    pub x: DVector<f64>,
    /// Lagrange multipliers of the rows, m, none negative: `H x + g + A' u = 0`, and `u` vanishes where a row is slack.
    pub multipliers: DVector<f64>,
    /// Rows that were taken up or dropped.
    pub iterations: usize,
}

/// Why there is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QpError {
    /// Sizes that do not belong together, or values that are not numbers.
    #[error("the program is not well formed: {0}")]
    Malformed(String),
    /// The cost does not grow in every direction.
    #[error("the Hessian is not positive definite")]
    NotConvex,
    /// The rows contradict each other.
    #[error("no point satisfies all rows: row {row} contradicts the others")]
    Infeasible {
        /// The row that could not be satisfied with those before.
        row: usize,
    },
    /// Rounding errors keep the method from ending; the rows are scaled too differently.
    #[error("no end after {iterations} iterations")]
    NoEnd {
        /// How many were made.
        iterations: usize,
    },
}

/// Rows may be broken by this share of their own scale.
const TOLERANCE: f64 = 1e-13;
/// A row whose part outside the active ones is smaller than this share counts as dependent on them.
const DEPENDENT: f64 = 1e-11;

/// Solves a program from its unconstrained minimum by taking up one violated row after the other.
///
/// # Errors
/// [`QpError`].
///
/// # Source
/// Goldfarb and Idnani, A numerically stable dual method for solving strictly convex quadratic programs, 1983. In the variables
/// `L' x` of the Cholesky factor the problem is the nearest point of a polyhedron, and the active rows are kept as an orthonormal basis.
pub fn solve_qp(program: &QuadraticProgram) -> Result<QpSolution, QpError> {
    let QuadraticProgram { hessian, gradient, rows, bounds } = program;
    let (n, m) = (gradient.len(), bounds.len());
    if hessian.shape() != (n, n) || rows.shape() != (m, n) || n == 0 {
        let message = format!("H is {:?}, g {n}, A {:?}, b {m}; expected H n x n, A m x n", hessian.shape(), rows.shape());
        return Err(QpError::Malformed(message));
    }
    let is_number = |values: &[f64]| values.iter().all(|v| v.is_finite());
    if !is_number(hessian.as_slice()) || !is_number(gradient.as_slice()) || !is_number(rows.as_slice()) {
        return Err(QpError::Malformed("a value of H, g or A is not a finite number".to_owned()));
    }
    if bounds.iter().any(|b| b.is_nan() || *b == f64::NEG_INFINITY) {
        return Err(QpError::Malformed("a bound is not a number above minus infinity".to_owned()));
    }
    let factor = Cholesky::new(hessian.clone()).ok_or(QpError::NotConvex)?;
    let lower = factor.l();
    // y = L' x and the rows C = A L^-T, one in each column, scaled to length 1.
    let mut start = -gradient.clone();
    lower.solve_lower_triangular_mut(&mut start);
    let mut normals = rows.transpose();
    lower.solve_lower_triangular_mut(&mut normals);
    let mut scaled_bounds = bounds.clone();
    let mut scales = DVector::from_element(m, 1.0);
    for (row, mut normal) in normals.column_iter_mut().enumerate() {
        let length = normal.norm();
        if length > f64::MIN_POSITIVE {
            normal /= length;
            scaled_bounds[row] /= length;
            scales[row] = length;
        } else if bounds[row] < 0.0 {
            return Err(QpError::Infeasible { row });
        } else {
            scaled_bounds[row] = f64::INFINITY;
        }
    }
    let mut search = Search { normals: &normals, bounds: &scaled_bounds, y: start, active: Active::new(n), iterations: 0 };
    search.run()?;
    let mut multipliers = DVector::zeros(m);
    for (row, u) in search.active.rows.iter().zip(&search.active.multipliers) {
        multipliers[*row] = u / scales[*row];
    }
    let mut x = search.y;
    lower.tr_solve_lower_triangular_mut(&mut x);
    Ok(QpSolution { x, multipliers, iterations: search.iterations })
}

/// Rows held with equality.
struct Active {
    n: usize,
    rows: Vec<usize>,
    multipliers: Vec<f64>,
    /// Orthonormal basis of their normals, vector by vector.
    basis: Vec<f64>,
    /// The normals in that basis: upper triangle, column by column, `n` apart.
    triangle: Vec<f64>,
}

impl Active {
    fn new(n: usize) -> Self {
        let (rows, multipliers) = (Vec::with_capacity(n), Vec::with_capacity(n));
        Self { n, rows, multipliers, basis: Vec::with_capacity(n * n), triangle: Vec::with_capacity(n * n) }
    }

    /// Splits a normal: its coordinates in the basis, and what is left of it.
    fn split(&self, normal: &[f64], coordinates: &mut [f64], rest: &mut [f64]) {
        rest.copy_from_slice(normal);
        coordinates.fill(0.0);
        // Twice is enough to be orthogonal to the last digit.
        for _ in 0..2 {
            for (coordinate, vector) in coordinates.iter_mut().zip(self.basis.chunks_exact(self.n)) {
                let along = dot(vector, rest);
                *coordinate += along;
                rest.iter_mut().zip(vector).for_each(|(rest, v)| *rest -= along * v);
            }
        }
    }

    fn push(&mut self, row: usize, multiplier: f64, coordinates: &[f64], rest: &[f64]) {
        let length = dot(rest, rest).sqrt();
        let k = self.rows.len();
        self.basis.extend(rest.iter().map(|v| v / length));
        self.triangle.resize((k + 1) * self.n, 0.0);
        self.triangle[k * self.n..k * self.n + k].copy_from_slice(&coordinates[..k]);
        self.triangle[k * self.n + k] = length;
        self.rows.push(row);
        self.multipliers.push(multiplier);
    }

    /// How the multipliers change for each unit of a new row: solves the triangle for its coordinates.
    fn changes(&self, coordinates: &[f64], changes: &mut [f64]) {
        for i in (0..self.rows.len()).rev() {
            let above: f64 = (i + 1..self.rows.len()).map(|j| self.triangle[j * self.n + i] * changes[j]).sum();
            changes[i] = (coordinates[i] - above) / self.triangle[i * self.n + i];
        }
    }

    /// Drops one row and rebuilds the basis of those after it.
    fn remove(&mut self, place: usize, normals: &DMatrix<f64>) {
        let later: Vec<(usize, f64)> = self.rows.drain(place..).zip(self.multipliers.drain(place..)).skip(1).collect();
        self.basis.truncate(place * self.n);
        self.triangle.truncate(place * self.n);
        let (mut coordinates, mut rest) = (vec![0.0; self.n], vec![0.0; self.n]);
        for (row, multiplier) in later {
            self.split(normals.column(row).as_slice(), &mut coordinates, &mut rest);
            self.push(row, multiplier, &coordinates, &rest);
        }
    }
}

struct Search<'a> {
    normals: &'a DMatrix<f64>,
    bounds: &'a DVector<f64>,
    y: DVector<f64>,
    active: Active,
    iterations: usize,
}

impl Search<'_> {
    fn run(&mut self) -> Result<(), QpError> {
        let most = 50 * (self.y.len() + self.bounds.len());
        while let Some(row) = self.most_violated() {
            self.take_up(row, most)?;
        }
        Ok(())
    }

    fn excess(&self, row: usize) -> f64 {
        dot(self.normals.column(row).as_slice(), self.y.as_slice()) - self.bounds[row]
    }

    fn most_violated(&self) -> Option<usize> {
        let size = 1.0 + self.y.amax();
        let mut worst = None;
        let mut most = 0.0;
        for row in 0..self.bounds.len() {
            let excess = self.excess(row);
            if excess > most && excess > TOLERANCE * (size + self.bounds[row].abs()) && !self.active.rows.contains(&row) {
                (worst, most) = (Some(row), excess);
            }
        }
        worst
    }

    /// Moves to the nearest point that also satisfies `row`, dropping rows that no longer hold it back.
    fn take_up(&mut self, row: usize, most: usize) -> Result<(), QpError> {
        let n = self.y.len();
        let normal = self.normals.column(row);
        let normal = normal.as_slice();
        let (mut coordinates, mut rest, mut changes) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        let mut multiplier = 0.0;
        loop {
            self.iterations += 1;
            if self.iterations > most {
                return Err(QpError::NoEnd { iterations: self.iterations });
            }
            let k = self.active.rows.len();
            self.active.split(normal, &mut coordinates[..k], &mut rest);
            self.active.changes(&coordinates[..k], &mut changes[..k]);
            let rest2 = dot(&rest, &rest);
            let is_dependent = k == n || rest2 < DEPENDENT * DEPENDENT;
            // The first multiplier that vanishes on the way.
            let falling = (0..k).filter(|i| changes[*i] > 1e-14).map(|i| (self.active.multipliers[i] / changes[i], i));
            let first = falling.min_by(|a, b| a.0.total_cmp(&b.0));
            let whole = if is_dependent { f64::INFINITY } else { self.excess(row) / rest2 };
            let (step, dropped) = match first {
                Some((at, place)) if at < whole => (at, Some(place)),
                _ => (whole, None),
            };
            if step.is_infinite() {
                return Err(QpError::Infeasible { row });
            }
            if !is_dependent {
                self.y.as_mut_slice().iter_mut().zip(&rest).for_each(|(y, z)| *y -= step * z);
            }
            self.active.multipliers.iter_mut().zip(&changes).for_each(|(u, r)| *u = (*u - step * r).max(0.0));
            multiplier += step;
            match dropped {
                Some(place) => self.active.remove(place, self.normals),
                None => {
                    self.active.push(row, multiplier, &coordinates, &rest);
                    return Ok(());
                }
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;
    use clarabel::algebra::CscMatrix;
    use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver as _, NonnegativeConeT};
    use rand::{Rng, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// A velocity program as control has them: a task's Jacobian, a box and a few rows of its own.
    fn program(rng: &mut ChaCha8Rng, n: usize, m: usize) -> QuadraticProgram {
        let jacobian = DMatrix::from_fn(6, n, |_, _| rng.random_range(-1.0..1.0));
        let hessian = jacobian.transpose() * &jacobian + DMatrix::identity(n, n) * 1e-2;
        let wanted = DVector::from_fn(6, |_, _| rng.random_range(-1.0..1.0));
        let gradient = -(jacobian.transpose() * wanted);
        let rows = DMatrix::from_fn(m, n, |row, column| match row {
            row if row < n => f64::from(u8::from(row == column)),
            row if row < 2 * n => -f64::from(u8::from(row - n == column)),
            _ => rng.random_range(-1.0..1.0),
        });
        let bounds = DVector::from_fn(m, |_, _| rng.random_range(0.02..1.0));
        QuadraticProgram { hessian, gradient, rows, bounds }
    }

    /// By how much the optimality conditions are broken.
    fn residual(program: &QuadraticProgram, solution: &QpSolution) -> f64 {
        let QpSolution { x, multipliers, .. } = solution;
        let stationary = &program.hessian * x + &program.gradient + program.rows.transpose() * multipliers;
        let slack = &program.bounds - &program.rows * x;
        let feasible = slack.iter().fold(0.0, |worst: f64, s| worst.max(-s));
        let complementary = slack.iter().zip(multipliers).fold(0.0, |worst: f64, (s, u)| worst.max((s.min(1e9) * u).abs()));
        let signs = multipliers.iter().fold(0.0, |worst: f64, u| worst.max(-u));
        stationary.amax().max(feasible).max(complementary).max(signs)
    }

    /// Its solution on the rows that it names as active; none where it cannot tell whether one is.
    fn by_clarabel(program: &QuadraticProgram) -> Option<Vec<f64>> {
        let n = program.gradient.len();
        let dense = |matrix: &DMatrix<f64>, keep: &dyn Fn(usize, usize) -> bool| {
            let rows: Vec<Vec<f64>> = (0..matrix.nrows())
                .map(|row| (0..n).map(|column| if keep(row, column) { matrix[(row, column)] } else { 0.0 }).collect())
                .collect();
            CscMatrix::from(&rows)
        };
        let (p, a) = (dense(&program.hessian, &|row, column| row <= column), dense(&program.rows, &|_, _| true));
        let settings = DefaultSettingsBuilder::default()
            .verbose(false)
            .tol_gap_abs(1e-14)
            .tol_gap_rel(1e-14)
            .tol_feas(1e-14)
            .max_iter(200)
            .build()
            .unwrap();
        let cones = [NonnegativeConeT(program.bounds.len())];
        let mut solver =
            DefaultSolver::new(&p, program.gradient.as_slice(), &a, program.bounds.as_slice(), &cones, settings).unwrap();
        solver.solve();
        // An interior point stops short of the rows that it names as active, by the root of its gap; on them it is exact.
        let solution = &solver.solution;
        let is_open = |row: usize| (solution.z[row] / solution.s[row]).log10().abs() < 2.0;
        if (0..program.bounds.len()).any(is_open) {
            return None;
        }
        let active: Vec<usize> = (0..program.bounds.len()).filter(|row| solution.z[*row] > solution.s[*row]).collect();
        let k = active.len();
        let kkt = DMatrix::from_fn(n + k, n + k, |i, j| match (i < n, j < n) {
            (true, true) => program.hessian[(i, j)],
            (true, false) => program.rows[(active[j - n], i)],
            (false, true) => program.rows[(active[i - n], j)],
            (false, false) => 0.0,
        });
        let right = DVector::from_fn(n + k, |i, _| if i < n { -program.gradient[i] } else { program.bounds[active[i - n]] });
        let exact = kkt.lu().solve(&right).unwrap();
        assert!(exact.rows(0, n).iter().zip(&solution.x).all(|(a, b)| (a - b).abs() < 1e-3), "{exact} {:?}", solution.x);
        Some(exact.rows(0, n).iter().copied().collect())
    }

    #[test]
    fn solutions_are_those_of_clarabel() {
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let (mut n_active, mut n_compared, mut worst) = (0, 0, 0.0_f64);
        for round in 0..400 {
            let (n, m) = if round % 2 == 0 { (7, 30) } else { (14, 50) };
            let program = program(&mut rng, n, m);
            let solution = solve_qp(&program).unwrap();
            n_active += solution.multipliers.iter().filter(|u| **u > 0.0).count();
            assert!(residual(&program, &solution) < 1e-11, "{}", residual(&program, &solution));
            let Some(reference) = by_clarabel(&program) else { continue };
            n_compared += 1;
            let gap = solution.x.iter().zip(&reference).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            worst = worst.max(gap);
        }
        assert!(worst < 1e-9 && n_compared > 380, "{worst:.1e} in {n_compared} of 400");
        assert!(n_active > 400, "{n_active} active rows in 400 programs");
    }

    #[test]
    fn a_slack_program_ends_at_its_own_minimum() {
        let program = QuadraticProgram {
            hessian: DMatrix::identity(2, 2) * 2.0,
            gradient: DVector::from_vec(vec![-2.0, 4.0]),
            rows: DMatrix::zeros(1, 2),
            bounds: DVector::from_element(1, 0.0),
        };
        let solution = solve_qp(&program).unwrap();
        assert!((solution.x - DVector::from_vec(vec![1.0, -2.0])).amax() < 1e-15 && solution.iterations == 0);
    }

    #[test]
    fn degenerate_and_repeated_rows_do_not_disturb() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        for _ in 0..200 {
            let mut program = program(&mut rng, 7, 30);
            // The same row three times, once scaled; and one through the solution without them.
            for copy in [15, 16] {
                let row = program.rows.row(14) * (copy as f64 - 13.0);
                program.rows.set_row(copy, &row);
                program.bounds[copy] = program.bounds[14] * (copy as f64 - 13.0);
            }
            let first = solve_qp(&program).unwrap();
            let through = program.rows.row(20).dot(&first.x.transpose());
            program.bounds[20] = through;
            let second = solve_qp(&program).unwrap();
            assert!(residual(&program, &second) < 1e-11);
            assert!((first.x - second.x).amax() < 1e-9);
        }
    }

    #[test]
    fn what_cannot_be_solved_says_why() {
        let rows = DMatrix::from_row_slice(2, 1, &[1.0, -1.0]);
        let program = QuadraticProgram {
            hessian: DMatrix::identity(1, 1),
            gradient: DVector::zeros(1),
            rows,
            bounds: DVector::from_vec(vec![-1.0, -1.0]),
        };
        assert!(matches!(solve_qp(&program), Err(QpError::Infeasible { .. })));
        let flat = QuadraticProgram { hessian: DMatrix::zeros(1, 1), ..program.clone() };
        assert_eq!(solve_qp(&flat), Err(QpError::NotConvex));
        let broken = QuadraticProgram { gradient: DVector::from_element(1, f64::NAN), ..program.clone() };
        assert!(matches!(solve_qp(&broken), Err(QpError::Malformed(_))));
        let wrong = QuadraticProgram { bounds: DVector::zeros(3), ..program };
        assert!(solve_qp(&wrong).unwrap_err().to_string().contains("expected H n x n"));
    }
}
