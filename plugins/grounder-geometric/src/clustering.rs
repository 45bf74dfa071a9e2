//! Separates the things on the table: connected columns of a grid seen from above.
//!
//! Columns rather than voxels, because both cameras look down: the visible top and the visible foot of one thing always share
//! columns, while its hidden middle would tear a voxel component apart. The price: things that touch, or that lean over each
//! other, become one cluster.

use crate::cloud::{CloudPoint, RobotBody};
use crate::table::Table;

/// Lower points are table noise.
pub(crate) const MIN_HEIGHT_M: f32 = 0.008;
/// Higher points are no thing on the table.
const MAX_HEIGHT_M: f32 = 0.45;
const CELL_M: f32 = 0.008;
/// Fewer points in a column are noise of the table or flying pixels at a silhouette.
const MIN_POINTS_PER_CELL: u16 = 3;
/// Smaller clusters are specks.
const MIN_POINTS: usize = 60;
const MIN_CELLS: usize = 6;
/// A column about table height belongs to the thing beside it when so many points have at least this mean height.
const MIN_POINTS_PER_LOW_CELL: u32 = 8;
const LOW_MEAN_M: f32 = 0.0022;
const MIN_LOW_NEIGHBOURS: usize = 4;
/// Lower points of such a column are table.
pub(crate) const LOW_POINT_M: f32 = 0.001;
/// Thin parts are followed this far from the thing that rises beside them.
const BORDER_M: f32 = 0.16;
/// A piece whose lowest point is higher floats.
const FRAGMENT_HEIGHT_M: f32 = 0.014;
/// A floating piece belongs to a thing this near: room for the hand inside a handle.
const FRAGMENT_GAP_M: f32 = 0.045;

/// The points of each thing, in no particular order of things; table, robot and specks are gone.
pub(crate) fn clusters(points: &[CloudPoint], table: &Table, robot: &RobotBody) -> Vec<Vec<CloudPoint>> {
    let above: Vec<CloudPoint> = points
        .iter()
        .filter(|point| {
            let p = &point.position;
            let height = p.z - table.height_at(p.x, p.y);
            height > MIN_HEIGHT_M && height < MAX_HEIGHT_M && table.carries(p.x, p.y) && !robot.contains(p)
        })
        .copied()
        .collect();
    let Some(grid) = Grid::around(&above) else { return Vec::new() };
    let mut counts = vec![0_u16; grid.len()];
    for point in &above {
        if let Some(cell) = grid.cell(point) {
            counts[cell] = counts[cell].saturating_add(1);
        }
    }
    let (mut labels, cell_counts) = grid.components(&counts);
    let mut things: Vec<Vec<CloudPoint>> = vec![Vec::new(); cell_counts.len()];
    for point in above {
        let Some(cell) = grid.cell(&point) else { continue };
        // A sparse column beside a full one is the thing's edge.
        let label = if labels[cell] > 0 { labels[cell] } else { grid.neighbours(cell).map(|c| labels[c]).max().unwrap_or(0) };
        if label > 0 {
            things[label - 1].push(point);
        }
    }
    let hosts = join_fragments(&mut things, table);
    // Specks are told by their points above the noise, before thin parts are added.
    let keep: Vec<bool> =
        things.iter().zip(cell_counts).map(|(points, n)| points.len() >= MIN_POINTS && n >= MIN_CELLS).collect();
    let low = low_points(points, table, &grid);
    let core = labels.clone();
    grow_into_low_cells(&low, &grid, &mut labels);
    for (point, height, cell) in low {
        // Columns of the thing itself already have their points; what is low there may be table.
        if core[cell] == 0 && labels[cell] > 0 && height > LOW_POINT_M && !robot.contains(&point.position) {
            things[hosts[labels[cell] - 1]].push(point);
        }
    }
    things.into_iter().zip(keep).filter(|(_, keep)| *keep).map(|(points, _)| points).collect()
}

/// Points about the height of the table, with their height and cell.
fn low_points(points: &[CloudPoint], table: &Table, grid: &Grid) -> Vec<(CloudPoint, f32, usize)> {
    let lows = points.iter().filter_map(|point| {
        let cell = grid.cell(point)?;
        let p = &point.position;
        let height = p.z - table.height_at(p.x, p.y);
        (height.abs() <= MIN_HEIGHT_M).then_some((*point, height, cell))
    });
    lows.collect()
}

/// Spreads each thing into neighbouring columns whose mean height is above the table's noise.
///
/// The blade of a spatula is thinner than the noise of one pixel, but not than that of the mean of twenty.
fn grow_into_low_cells(low: &[(CloudPoint, f32, usize)], grid: &Grid, labels: &mut [usize]) {
    let mut sums = vec![(0.0_f32, 0_u32); grid.len()];
    for (_, height, cell) in low {
        sums[*cell].0 += height;
        sums[*cell].1 += 1;
    }
    let is_raised = |cell: usize| {
        labels[cell] == 0 && sums[cell].1 >= MIN_POINTS_PER_LOW_CELL && sums[cell].0 > LOW_MEAN_M * sums[cell].1 as f32
    };
    let raised: Vec<bool> = (0..grid.len()).map(is_raised).collect();
    // Along every wall runs a strip one column wide that mixes wall and table. A blade is wider.
    let in_blade = |cell: usize| raised[cell] && grid.neighbours(cell).filter(|&c| raised[c]).count() >= MIN_LOW_NEIGHBOURS;
    let mut stack: Vec<usize> = (0..labels.len()).filter(|&cell| labels[cell] > 0).collect();
    while let Some(cell) = stack.pop() {
        for next in grid.neighbours(cell) {
            if labels[next] == 0 && grid.is_inner(next) && in_blade(next) {
                labels[next] = labels[cell];
                stack.push(next);
            }
        }
    }
}

/// Gives each small piece that floats above the table to the large thing beside it.
///
/// The grip of a handle that points away from the cameras is seen over the rim, apart from its mug; nothing that small hangs
/// in the air by itself. The same goes for a speck inside the outline of a thing: the floor of a bowl. Returns for each piece the thing it is now part of.
fn join_fragments(things: &mut [Vec<CloudPoint>], table: &Table) -> Vec<usize> {
    let mut hosts: Vec<usize> = (0..things.len()).collect();
    for fragment in 0..things.len() {
        let floats = |p: &CloudPoint| p.position.z - table.height_at(p.position.x, p.position.y) > FRAGMENT_HEIGHT_M;
        if things[fragment].is_empty() {
            continue;
        }
        let inside = |thing: &Vec<CloudPoint>| {
            let ([low, high], [inner_low, inner_high]) = (bounds(thing), bounds(&things[fragment]));
            (0..2).all(|axis| low[axis] <= inner_low[axis] && inner_high[axis] <= high[axis])
        };
        let floating = things[fragment].iter().all(floats);
        let gap_to = |thing: &Vec<CloudPoint>| {
            let mut gap = f32::MAX;
            for a in thing.iter().step_by(1 + thing.len() / 400) {
                for b in things[fragment].iter().step_by(1 + things[fragment].len() / 100) {
                    gap = gap.min((a.position - b.position).norm());
                }
            }
            gap
        };
        let host = (0..things.len())
            .filter(|&i| i != fragment && things[i].len() > 5 * things[fragment].len())
            .map(|i| (i, gap_to(&things[i])))
            .filter(|&(i, gap)| (floating && gap < FRAGMENT_GAP_M) || inside(&things[i]))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((host, _)) = host {
            let points = std::mem::take(&mut things[fragment]);
            things[host].extend(points);
            hosts[fragment] = host;
        }
    }
    hosts
}

/// Smallest and largest x and y.
fn bounds(points: &[CloudPoint]) -> [[f32; 2]; 2] {
    let start = [[f32::MAX; 2], [f32::MIN; 2]];
    points.iter().fold(start, |[low, high], p| {
        let (x, y) = (p.position.x, p.position.y);
        [[low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]]
    })
}

/// Columns over the points and [`BORDER_M`] around; the outermost columns stay empty, so that every used one has eight neighbours.
struct Grid {
    min_x: f32,
    min_y: f32,
    n_x: usize,
    n_y: usize,
}

impl Grid {
    fn around(points: &[CloudPoint]) -> Option<Self> {
        let first = points.first()?.position;
        let (mut min_x, mut max_x, mut min_y, mut max_y) = (first.x, first.x, first.y, first.y);
        for point in points {
            min_x = min_x.min(point.position.x);
            max_x = max_x.max(point.position.x);
            min_y = min_y.min(point.position.y);
            max_y = max_y.max(point.position.y);
        }
        let (min_x, min_y, max_x, max_y) = (min_x - BORDER_M, min_y - BORDER_M, max_x + BORDER_M, max_y + BORDER_M);
        let cells = |low: f32, high: f32| ((high - low) / CELL_M) as usize + 3;
        Some(Self { min_x, min_y, n_x: cells(min_x, max_x), n_y: cells(min_y, max_y) })
    }

    fn len(&self) -> usize {
        self.n_x * self.n_y
    }

    /// The column of a point, `None` outside.
    fn cell(&self, point: &CloudPoint) -> Option<usize> {
        let (u, v) = ((point.position.x - self.min_x) / CELL_M, (point.position.y - self.min_y) / CELL_M);
        let inside = u >= 0.0 && v >= 0.0 && u < (self.n_x - 2) as f32 && v < (self.n_y - 2) as f32;
        inside.then(|| (u as usize + 1) * self.n_y + v as usize + 1)
    }

    fn is_inner(&self, cell: usize) -> bool {
        let (i, j) = (cell / self.n_y, cell % self.n_y);
        i > 0 && j > 0 && i + 1 < self.n_x && j + 1 < self.n_y
    }

    fn neighbours(&self, cell: usize) -> impl Iterator<Item = usize> {
        let n_y = self.n_y;
        [cell - n_y - 1, cell - n_y, cell - n_y + 1, cell - 1, cell + 1, cell + n_y - 1, cell + n_y, cell + n_y + 1].into_iter()
    }

    /// Label of each cell (0 = none, first component = 1) and the number of cells of each component.
    fn components(&self, counts: &[u16]) -> (Vec<usize>, Vec<usize>) {
        let mut labels = vec![0_usize; counts.len()];
        let mut sizes = Vec::new();
        let mut stack = Vec::new();
        for start in 0..counts.len() {
            if counts[start] < MIN_POINTS_PER_CELL || labels[start] != 0 {
                continue;
            }
            sizes.push(0);
            let label = sizes.len();
            labels[start] = label;
            stack.push(start);
            while let Some(cell) = stack.pop() {
                sizes[label - 1] += 1;
                for next in self.neighbours(cell) {
                    if counts[next] >= MIN_POINTS_PER_CELL && labels[next] == 0 {
                        labels[next] = label;
                        stack.push(next);
                    }
                }
            }
        }
        (labels, sizes)
    }
}
