//! Residuals of a calibration: the force along the axis, followed by the components across it. The latter are used if
//! the load cell measured a vector and the model predicts one (`compare::components`).

use super::problem::Recorded;
use super::task::LoadCell;
use crate::compare::alignment::Beside;
use crate::compare::components::{Component, take_load_cell_off};
use crate::compare::path::ForcePath;
use crate::compare::rows::Rows;
use crate::compare::{Answer, Run};

impl Recorded<'_> {
    /// Stores the measured components across the axis at the rows.
    pub(crate) fn take_components(&mut self, first: &Run, rows: &[&Answer]) {
        self.across = first.across(rows, self.task.force_error);
        self.vectors = first.predicts_vectors();
    }

    /// The components across the axis that are fitted: none for a model with symmetry about the axis.
    pub(crate) fn across_fitted(&self) -> &[Component] {
        if self.vectors { &self.across } else { &[] }
    }

    /// Number of residuals: the fitted rows, along the axis and across it.
    pub(crate) fn residual_count(&self) -> usize {
        self.fitted.len() * (1 + self.across_fitted().len())
    }

    /// The values of a column at the fitted rows.
    pub(crate) fn at_fitted(&self, column: &[f64]) -> Vec<f64> {
        self.fitted.iter().map(|&i| column[i]).collect()
    }

    /// Concatenates the columns of the components at the fitted rows. Those across the axis are weighted, and the
    /// zero and drift of the load cell are projected out of them. Components that are not fitted are dropped.
    pub(crate) fn one_column(&self, components: impl Iterator<Item = Vec<f64>>) -> Vec<f64> {
        let weights = std::iter::once(None).chain(self.across_fitted().iter().map(|c| Some(c.weight)));
        let mut all = Vec::with_capacity(self.residual_count());
        for (mut column, weight) in components.zip(weights) {
            if let Some(weight) = weight {
                self.take_zero_off(&mut column);
                column.iter_mut().for_each(|c| *c *= weight);
            }
            all.append(&mut column);
        }
        all
    }

    fn take_zero_off(&self, column: &mut [f64]) {
        let free = match self.task.load_cell {
            LoadCell::Exact => 0,
            LoadCell::Offset => 1,
            LoadCell::Drift | LoadCell::Auto => 2,
        };
        take_load_cell_off(column, &self.at_fitted(&self.forces.time_s), free);
    }

    /// The measured force along the axis without the load cell's contribution, then across it, at the fitted rows.
    pub(crate) fn all_measured(&self, x: &[f64]) -> Vec<f64> {
        let along = self.fitted.iter().map(|&i| self.forces.measured_n[i] - self.added(x, self.forces.time_s[i]));
        let across = self.across_fitted().iter().map(|c| self.at_fitted(&c.measured_n));
        self.one_column(std::iter::once(along.collect()).chain(across))
    }

    /// The components across the axis at the fitted rows, for their alignment with the last run.
    pub(crate) fn beside(&self) -> Vec<Beside> {
        let paths = self.kept.iter().flat_map(|kept| &kept.paths[1..]);
        let one = |(c, path): (&Component, &ForcePath)| Beside {
            path: path.clone(),
            measured_n: self.at_fitted(&c.measured_n),
            weight: c.weight,
        };
        self.across_fitted().iter().zip(paths).map(one).collect()
    }

    /// Weights of the components that are fitted.
    pub(crate) fn weights(&self) -> Vec<f64> {
        std::iter::once(1.0).chain(self.across_fitted().iter().map(|c| c.weight)).collect()
    }

    /// The fitted rows of each component across the axis with its name, for the verdict. `predicted` holds each
    /// component at all rows.
    pub(crate) fn rows_across(&self, along: &Rows, predicted: &[Vec<f64>]) -> Vec<(String, Rows)> {
        let rows = |(c, predicted): (&Component, &Vec<f64>)| {
            let predicted_n = self.at_fitted(predicted);
            let measured = self.at_fitted(&c.measured_n);
            let mut residual: Vec<f64> = predicted_n.iter().zip(&measured).map(|(p, m)| p - m).collect();
            self.take_zero_off(&mut residual);
            let measured_n = predicted_n.iter().zip(&residual).map(|(p, r)| p - r).collect();
            (c.name.clone(), Rows { predicted_n, measured_n, whole_n: along.peak_n(), ..along.clone() })
        };
        self.across.iter().zip(predicted).map(rows).collect()
    }
}
