//! Fits the piecewise linear friction force that the second insertion and the retraction have in common.

use nalgebra::{DMatrix, DVector};

use super::found::{AIR, Known, LayersError, PIECE, PUSHED, Reading};

/// Part of the retraction that is left out, from its lowest force on, in diameters.
const TURNED: f64 = 0.2;
/// First and last step size of the search for breakpoints, in diameters.
const STEPS: [f64; 2] = [0.4, 0.002];
/// Largest number of rounds of that search; some hundred are usual.
const MOST_ROUNDS: usize = 5000;

/// Means of readings over intervals of a width, m: depth in m and force in N, from the top.
pub(super) fn pieces(readings: &[Reading], width: f64) -> Vec<[f64; 2]> {
    let mut sums: std::collections::BTreeMap<i64, [f64; 3]> = std::collections::BTreeMap::new();
    for [_, d, f] in readings {
        #[allow(clippy::cast_possible_truncation)]
        let sum = sums.entry((d / width).floor() as i64).or_default();
        *sum = [sum[0] + 1.0, sum[1] + d, sum[2] + f];
    }
    sums.values().map(|[n, d, f]| [d / n, f / n]).collect()
}

/// Piecewise linear friction force, shared by the retraction and the second insertion.
pub(super) struct Fit {
    out: Vec<[f64; 2]>,
    again: Vec<[f64; 2]>,
    pub layers: usize,
    /// Depths of the breakpoints, m: those of the second insertion, the start of its last rise, then those of the
    /// retraction.
    breaks: Vec<f64>,
    /// Friction per length of each layer, N/m, and slope of the last rise.
    forces: DVector<f64>,
    /// Depth at which the friction of the retraction is complete, m: that of its lowest force.
    turned: f64,
    /// Sum of squares of the residual, N^2.
    squares: f64,
    /// Standard errors of forces and breaks.
    errors: Vec<f64>,
}

/// Length of the part of the path to `depth` that lies between `from` and `to`.
fn within(depth: f64, from: f64, to: Option<f64>) -> f64 {
    let way = (depth - from).max(0.0);
    to.map_or(way, |to| way.min((to - from).max(0.0)))
}

impl Fit {
    pub(crate) fn new(
        out: &[Reading],
        again: Option<&[Reading]>,
        diameter: f64,
        layers: usize,
        drops: &[f64],
    ) -> Result<Self, LayersError> {
        let piece = PIECE * diameter;
        let mut up = pieces(out, piece);
        let lowest = up.iter().min_by(|a, b| a[1].total_cmp(&b[1])).map_or(0.0, |p| p[0]);
        up.retain(|p| p[0] < lowest - TURNED * diameter && p[0] > -diameter);
        let mut down = again.map(|leg| pieces(leg, piece)).unwrap_or_default();
        down.retain(|p| p[0] > -AIR * diameter);
        let deepest = down.last().or(up.last()).map_or(0.0, |p| p[0]);
        if layers == 0 || up.len() + down.len() < 8 * (layers + 1) || up.len() < 4 * layers {
            return Err(LayersError::Few(layers));
        }
        let mut best: Option<Self> = None;
        for start in Self::starts(drops, layers, deepest, diameter) {
            let mut breaks = start.clone();
            // a second insertion shorter than one interval counts as none
            if !down.is_empty() {
                breaks.push(deepest - 0.7 * diameter);
                breaks.extend(&start);
            }
            let mut fit = Self {
                out: up.clone(),
                again: down.clone(),
                layers,
                breaks,
                forces: DVector::zeros(0),
                turned: lowest,
                squares: f64::INFINITY,
                errors: Vec::new(),
            };
            fit.search(STEPS.map(|s| s * diameter));
            // no forces: no breakpoints gave a friction that opposes the motion
            if !fit.forces.is_empty() && best.as_ref().is_none_or(|b| fit.squares < b.squares) {
                best = Some(fit);
            }
        }
        let mut fit = best.ok_or(LayersError::Undetermined(layers))?;
        fit.errors = fit.standard_errors().ok_or(LayersError::Undetermined(layers))?;
        Ok(fit)
    }

    /// Start values of the layers' boundaries: equal parts, and slightly above the drops.
    #[allow(clippy::cast_precision_loss)]
    fn starts(drops: &[f64], layers: usize, deepest: f64, diameter: f64) -> Vec<Vec<f64>> {
        let equal = (0..layers).map(|i| deepest * i as f64 / layers as f64).collect();
        let seen = (drops.len() >= layers).then(|| {
            let mut breaks = vec![0.0];
            breaks.extend(drops.iter().take(layers).skip(1).map(|d| d - 0.5 * diameter));
            breaks
        });
        std::iter::once(equal).chain(seen).collect()
    }

    /// Rows of the linear fit: layers, then the last rise.
    fn design(&self, breaks: &[f64]) -> DMatrix<f64> {
        let n = self.layers;
        let (down, up) = if self.again.is_empty() { (breaks, breaks) } else { breaks.split_at(n + 1) };
        let rise = if self.again.is_empty() { None } else { down.get(n) };
        let upper = |of: &[f64], i: usize| if i + 1 < n { of.get(i + 1).copied() } else { None };
        let value = |row: usize, column: usize| match (self.again.get(row), column < n) {
            (Some(p), true) => within(p[0], down.get(column).copied().unwrap_or(0.0), upper(down, column)),
            (Some(p), false) => rise.map_or(0.0, |r| (p[0] - r).max(0.0)),
            (None, true) => {
                let depth = self.out.get(row - self.again.len()).map_or(0.0, |p| p[0]);
                -within(depth, up.get(column).copied().unwrap_or(0.0), upper(up, column))
            }
            (None, false) => 0.0,
        };
        DMatrix::from_fn(self.again.len() + self.out.len(), n + usize::from(rise.is_some()), value)
    }

    fn force(&self) -> DVector<f64> {
        DVector::from_iterator(self.again.len() + self.out.len(), self.again.iter().chain(&self.out).map(|p| p[1]))
    }

    /// Forces for given breakpoints, and the remaining sum of squares; `None` if a friction would be negative.
    fn linear(&self, breaks: &[f64], force: &DVector<f64>) -> Option<(DVector<f64>, f64)> {
        let design = self.design(breaks);
        let normal = design.tr_mul(&design).cholesky()?;
        let forces = normal.solve(&design.tr_mul(force));
        let squares = (design * &forces - force).norm_squared();
        (forces.iter().all(|f| *f >= 0.0) && squares.is_finite()).then_some((forces, squares))
    }

    /// Coordinate search: moves one breakpoint after the other while the sum of squares falls, with decreasing steps.
    fn search(&mut self, [mut step, last]: [f64; 2]) {
        let force = self.force();
        if let Some((forces, squares)) = self.linear(&self.breaks, &force) {
            (self.forces, self.squares) = (forces, squares);
        }
        for _ in 0..MOST_ROUNDS {
            let mut moved = false;
            for (k, way) in (0..self.breaks.len()).flat_map(|k| [(k, step), (k, -step)]) {
                let mut breaks = self.breaks.clone();
                breaks.iter_mut().skip(k).take(1).for_each(|b| *b += way);
                if let Some((forces, squares)) = self.linear(&breaks, &force).filter(|(_, s)| *s < self.squares) {
                    (self.breaks, self.forces, self.squares, moved) = (breaks, forces, squares, true);
                }
            }
            if !moved {
                step *= 0.5;
            }
            if step <= last {
                return;
            }
        }
    }

    /// Standard errors of forces and breakpoints, from the fit's derivatives and residual.
    #[allow(clippy::cast_precision_loss)]
    fn standard_errors(&self) -> Option<Vec<f64>> {
        let design = self.design(&self.breaks);
        let (rows, linear) = design.shape();
        let here = &design * &self.forces;
        let residual = &here - self.force();
        let mut jacobian = design.resize_horizontally(linear + self.breaks.len(), 0.0);
        for k in 0..self.breaks.len() {
            let mut breaks = self.breaks.clone();
            breaks.iter_mut().skip(k).take(1).for_each(|b| *b += 1e-6);
            let column = (self.design(&breaks) * &self.forces - &here) / 1e-6;
            jacobian.set_column(linear + k, &column);
        }
        let freedom = rows.checked_sub(jacobian.ncols()).filter(|n| *n > 0)? as f64;
        // neighbouring residuals are correlated near breakpoints
        let both: f64 = residual.iter().zip(residual.iter().skip(1)).map(|(a, b)| a * b).sum();
        let alike = (both / residual.norm_squared()).clamp(0.0, 0.95);
        let variance = residual.norm_squared() / freedom * (1.0 + alike) / (1.0 - alike);
        let scale: Vec<f64> = jacobian.column_iter().map(|c| c.norm().max(1e-12)).collect();
        for (mut column, s) in jacobian.column_iter_mut().zip(&scale) {
            column /= *s;
        }
        let inverse = jacobian.tr_mul(&jacobian).cholesky()?.inverse();
        let each = inverse.diagonal().iter().zip(&scale).map(|(v, s)| (variance * v).sqrt() / s).collect();
        Some(each)
    }

    /// Parameter k: a force per length, or after these a breakpoint.
    fn known(&self, k: usize) -> Known {
        let value = self.forces.iter().chain(&self.breaks).nth(k).copied().unwrap_or(0.0);
        Known { value, standard_error: self.errors.get(k).copied().unwrap_or(f64::INFINITY) }
    }

    /// Upper boundary of a layer in undeformed tissue, m: the middle between the breakpoints of both motions.
    pub(crate) fn begins(&self, i: usize) -> Known {
        let (a, b) = (self.known(self.forces.len() + i), self.known(self.forces.len() + self.layers + 1 + i));
        let standard_error = 0.5 * a.standard_error.hypot(b.standard_error);
        Known { value: 0.5 * (a.value + b.value), standard_error }
    }

    /// Friction per length of a layer, N/m.
    pub(crate) fn friction(&self, i: usize) -> Known {
        self.known(i)
    }

    /// How far the tip has pushed tissue ahead of it at the end of an insertion, m, and the needle drags it back on the way
    /// out: as much of the shaft rubs at the end as where the friction of the way out is complete.
    pub(crate) fn pushed_m(&self, end: f64, diameter: f64) -> f64 {
        self.turn_m(end).min(PUSHED * diameter)
    }

    /// Way between the end of an insertion and where the friction of the way out is complete, m.
    pub(crate) fn turn_m(&self, end: f64) -> f64 {
        (end - self.turned).max(0.0)
    }

    /// Whether there was a second insertion.
    pub(crate) const fn is_double(&self) -> bool {
        !self.again.is_empty()
    }

    /// Breakpoint of a layer in the second insertion, m.
    pub(crate) fn comes(&self, i: usize) -> f64 {
        self.breaks.get(i).copied().unwrap_or(0.0)
    }

    /// Friction above a layer's undeformed upper boundary, N: the shaft friction when the tip is there.
    pub(crate) fn above(&self, i: usize) -> Known {
        let way = |j: usize| self.begins(j + 1).value - self.begins(j).value;
        let value = (0..i).map(|j| self.friction(j).value * way(j)).sum();
        let end = |j: usize, k: usize| self.friction(j).value * self.begins(k).standard_error;
        let standard_error = i.checked_sub(1).map_or(0.0, |last| end(0, 0).hypot(end(last, i)));
        Known { value, standard_error }
    }

    /// Friction along the channel of the first insertion, N, where the second insertion reaches its end; `None` if it
    /// does not.
    pub(crate) fn channel(&self) -> Option<Known> {
        let (n, last) = (self.layers, self.friction(self.layers.checked_sub(1)?).value);
        let (rise, end) = (self.known(n), self.known(self.forces.len() + n));
        let deepest = self.again.last().map(|p| p[0])?;
        // ignore a rise within the last intervals, or one that is not a rise
        (rise.value > last && end.value < deepest).then(|| {
            let next = |i: usize| if i + 1 < n { Some(self.comes(i + 1)) } else { None };
            let along = |i: usize| self.friction(i).value * within(end.value, self.comes(i), next(i));
            Known { value: (0..n).map(along).sum(), standard_error: last * end.standard_error }
        })
    }

    /// Friction along the shaft on the way out, N, where the tip is at a depth. Without a second insertion, which tells
    /// where the first layer begins, it is taken to begin at the surface or above.
    pub(crate) fn on_the_way_out(&self, depth: f64) -> Known {
        let n = self.layers;
        let first = self.breaks.len() - n;
        let begins = |i: usize| {
            let at = self.breaks.get(first + i).copied().unwrap_or(0.0);
            if i == 0 && !self.is_double() { at.min(0.0) } else { at }
        };
        let length = |i: usize| within(depth, begins(i), (i + 1 < n).then(|| begins(i + 1)));
        let part = |i: usize| self.friction(i).value * length(i);
        let begin = self.friction(0).value * self.known(self.forces.len() + first).standard_error;
        let error = |i: usize| self.friction(i).standard_error * length(i);
        Known { value: (0..n).map(part).sum(), standard_error: (0..n).map(error).fold(begin, f64::hypot) }
    }

    /// Root mean square residual, N.
    #[allow(clippy::cast_precision_loss)]
    pub(crate) fn rmse(&self) -> f64 {
        (self.squares / (self.again.len() + self.out.len()) as f64).sqrt()
    }
}
