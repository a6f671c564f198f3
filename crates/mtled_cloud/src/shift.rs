//! Shifts single nodes uphill in the quality of their worst cell.

use crate::improve::{GAIN, Mesh};
use crate::vector::{Point, add, hash01, norm, scale, sub};

impl Mesh<'_> {
    fn star_quality(&self, v: u32, stop: f64) -> f64 {
        let mut worst = f64::INFINITY;
        for &c in &self.star[v as usize] {
            worst = worst.min(self.measure(self.cells[c as usize]));
            if worst <= stop {
                break;
            }
        }
        worst
    }

    /// Climbs with one node: towards a better worst cell of its star; true if it moved.
    pub(super) fn shift(&mut self, v: u32) -> bool {
        if self.rules.fixed[v as usize] || self.rules.faces[v as usize].count_ones() > 1 {
            return false;
        }
        let face = self.rules.faces[v as usize];
        let mut worst = self.star[v as usize].iter().map(|&c| self.quality[c as usize]).fold(f64::INFINITY, f64::min);
        let size = self.star_size(v);
        let mut reach = 0.2 * size;
        let mut moved = false;
        for round in 0..12u64 {
            let home = self.points[v as usize];
            let mut best = (worst + GAIN, home);
            for k in 0..8u64 {
                let way = if k == 0 {
                    self.uphill(v)
                } else {
                    let h = |salt| hash01(u64::from(v) * 64 + round * 8 + k, salt) - 0.5;
                    [h(5), h(6), h(7)]
                };
                let step = reach / norm(way).max(f64::MIN_POSITIVE);
                let Some(q) = (self.rules.place)(face, add(home, scale(way, step))) else { continue };
                self.points[v as usize] = q;
                let reached = self.star_quality(v, best.0);
                if reached > best.0 {
                    best = (reached, q);
                }
            }
            self.points[v as usize] = best.1;
            if best.1 == home {
                reach *= 0.5;
            } else {
                worst = best.0;
                moved = true;
            }
        }
        if moved {
            for k in 0..self.star[v as usize].len() {
                let c = self.star[v as usize][k];
                self.quality[c as usize] = self.measure(self.cells[c as usize]);
            }
        }
        moved
    }

    /// Gradient of the worst cell's quality at this node, by differences.
    fn uphill(&mut self, v: u32) -> Point {
        let star = &self.star[v as usize];
        let Some(worst) =
            star.iter().map(|&c| self.cells[c as usize]).min_by(|a, b| self.measure(*a).total_cmp(&self.measure(*b)))
        else {
            return [0.0; 3];
        };
        let home = self.points[v as usize];
        let d = 1e-5 * self.star_size(v);
        let mut gradient = [0.0; 3];
        for k in 0..3 {
            for (sign, value) in [(1.0, d), (-1.0, -d)] {
                self.points[v as usize][k] = home[k] + value;
                gradient[k] += sign * self.measure(worst);
            }
            self.points[v as usize] = home;
        }
        gradient
    }

    fn star_size(&self, v: u32) -> f64 {
        let p = self.points[v as usize];
        let (mut sum, mut n) = (0.0, 0.0);
        for &c in &self.star[v as usize] {
            for w in self.cells[c as usize] {
                sum += norm(sub(self.points[w as usize], p));
            }
            n += 3.0;
        }
        sum / f64::max(n, 1.0)
    }
}
