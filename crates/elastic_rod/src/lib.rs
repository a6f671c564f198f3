//! Static equilibrium of a slender elastic rod (Kirchhoff), clamped at one end, under forces and springs.
//!
//! The rod is straight at rest and has the same stiffness in bending in all directions. Rotations may be large; what is neglected is shear, and
//! the stretch of the centre line is that of the section. N + 1 vertices x_i stand a length l apart, and the potential is
//!
//! ```text
//! U = sum over segments  E A / (2 l) (|x_i+1 - x_i| - l)^2
//!   + sum over vertices  E I / (2 l^3) |x_i-1 - 2 x_i + x_i+1|^2       curvature |x''| of a line that hardly stretches
//!   + E I / l^3 |x_1 - x_0 - l d|^2                                   clamp: half a cell whose neighbour is its mirror image, d: direction
//!   + sum over springs   k / 2 |P (x(s) - c)|^2                        P: across the spring's axis
//!   - sum over forces    f . x(s)
//! ```
//!
//! The quadratic form of the bending energy is that of Bergou, Wardetzky, Harmon, Zorin, Grinspun, "A quadratic bending model for inextensible
//! surfaces" (2006), of a line. Newton's method finds its minimum: a banded Cholesky factorisation, shifted where the Hessian is not positive
//! definite, and a line search on the potential. Cost and memory grow with N; a solution allocates nothing.

mod band;
mod section;

pub use section::Section;

use band::Band;

/// Iterations after which a solution is given up.
const MOST_ITERATIONS: usize = 500;
/// Largest step of Newton's method that ends the search, over the rod's length.
const CONVERGED: f64 = 1e-9;
/// Times that the line search halves a step.
const HALVINGS: u32 = 30;
/// Largest step of a vertex against its neighbour at once, over a segment's length: the stretching energy is steep.
const LONGEST_STEP: f64 = 0.5;

type Vector = [f64; 3];

/// Where the rod begins, and how it leaves there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clamp {
    /// Place of the first vertex, m.
    pub place: Vector,
    /// Unit vector along the rod.
    pub direction: Vector,
}

/// A force that keeps its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// Arc length from the clamp at which it acts, m.
    pub arc: f64,
    /// N.
    pub force: Vector,
}

/// A spring that pulls a point of the rod to a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// Arc length of the point from the clamp, m.
    pub arc: f64,
    /// A point of the line, m.
    pub place: Vector,
    /// Unit vector along the line, along which the spring does not act; zero: the spring acts in all directions.
    pub axis: Vector,
    /// k, N/m.
    pub stiffness: f64,
}

impl Spring {
    /// P v: what of a vector is across the axis.
    fn across(&self, v: Vector) -> Vector {
        let along = dot(v, self.axis);
        std::array::from_fn(|k| v[k] - along * self.axis[k])
    }

    /// Force on the rod whose point is at a place in m, N.
    #[must_use]
    pub fn force(&self, at: Vector) -> Vector {
        self.across(minus(at, self.place)).map(|x| -self.stiffness * x)
    }
}

/// Newton's method did not come to an equilibrium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NotConverged {
    /// Last step of a vertex, m.
    pub step_m: f64,
}

impl std::fmt::Display for NotConverged {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "the rod found no equilibrium in {MOST_ITERATIONS} iterations: its last step was {:.3e} m",
            self.step_m
        )
    }
}

impl std::error::Error for NotConverged {}

/// A rod and the shape that it has now.
#[derive(Debug)]
pub struct Rod {
    /// E I, N m^2.
    bending: f64,
    /// E A, N.
    stretching: f64,
    /// l, m.
    segment: f64,
    /// x_0 to x_N, m.
    x: Vec<Vector>,
    /// Scratch memory: of x_1 to x_N.
    step: Vec<f64>,
    gradient: Vec<f64>,
    trial: Vec<Vector>,
    kept: Vec<Vector>,
    hessian: Band,
    factor: Band,
}

impl Clone for Rod {
    fn clone(&self) -> Self {
        Self {
            bending: self.bending,
            stretching: self.stretching,
            segment: self.segment,
            x: self.x.clone(),
            step: self.step.clone(),
            gradient: self.gradient.clone(),
            trial: self.trial.clone(),
            kept: self.kept.clone(),
            hessian: self.hessian.clone(),
            factor: self.factor.clone(),
        }
    }

    /// Takes over the shape; of rods with the same number of segments it allocates nothing.
    fn clone_from(&mut self, other: &Self) {
        (self.bending, self.stretching, self.segment) = (other.bending, other.stretching, other.segment);
        self.x.clone_from(&other.x);
        if self.trial.len() != other.trial.len() {
            *self = other.clone();
        }
    }
}

impl Rod {
    /// A straight rod of a length in m, in segments (at least three), from a clamp.
    #[must_use]
    pub fn new(section: &Section, length_m: f64, segments: usize, clamp: &Clamp) -> Self {
        let segments = segments.max(3);
        let segment = length_m / segments as f64;
        let mut rod = Self {
            bending: section.bending_stiffness(),
            stretching: section.stretching_stiffness(),
            segment,
            x: vec![[0.0; 3]; segments + 1],
            step: vec![0.0; 3 * segments],
            gradient: vec![0.0; 3 * segments],
            trial: vec![[0.0; 3]; segments + 1],
            kept: vec![[0.0; 3]; segments + 1],
            hessian: Band::new(3 * segments),
            factor: Band::new(3 * segments),
        };
        rod.straighten(clamp);
        rod
    }

    /// Puts the rod straight out of a clamp.
    pub fn straighten(&mut self, clamp: &Clamp) {
        for (i, x) in self.x.iter_mut().enumerate() {
            let arc = i as f64 * self.segment;
            *x = std::array::from_fn(|k| clamp.place[k] + arc * clamp.direction[k]);
        }
    }

    /// Moves and turns the whole rod as its clamp goes, so that a search begins from the shape that it had.
    pub fn carry(&mut self, from: &Clamp, to: &Clamp) {
        for x in &mut self.x {
            let v = turned(minus(*x, from.place), from.direction, to.direction);
            *x = std::array::from_fn(|k| to.place[k] + v[k]);
        }
    }

    /// E I, N m^2.
    #[must_use]
    pub fn bending_stiffness(&self) -> f64 {
        self.bending
    }

    /// Length at rest, m.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.segment * (self.x.len() - 1) as f64
    }

    /// Places of the vertices from the clamp to the tip, m.
    #[must_use]
    pub fn vertices(&self) -> &[Vector] {
        &self.x
    }

    /// Place at an arc length from the clamp, m, on the straight segment between two vertices.
    #[must_use]
    pub fn at(&self, arc: f64) -> Vector {
        let (i, share) = self.between(arc);
        mixed(self.x[i], self.x[i + 1], share)
    }

    /// Unit vector along the rod at the tip: the tangent of a parabola through its last three vertices.
    #[must_use]
    pub fn tip_direction(&self) -> Vector {
        let n = self.x.len() - 1;
        let (last, before) = (minus(self.x[n], self.x[n - 1]), minus(self.x[n - 1], self.x[n - 2]));
        unit(std::array::from_fn(|k| 1.5 * last[k] - 0.5 * before[k]))
    }

    /// First of the two vertices about an arc length, and the share of the second.
    fn between(&self, arc: f64) -> (usize, f64) {
        let last = self.x.len() - 2;
        let i = ((arc / self.segment).max(0.0) as usize).min(last);
        (i, arc / self.segment - i as f64)
    }

    /// Bending and stretching energy, J.
    #[must_use]
    pub fn energy(&self, clamp: &Clamp) -> f64 {
        self.potential(&self.x, clamp, &[], &[])
    }

    /// Brings the rod into equilibrium, from the shape that it has, and says how many iterations that took.
    ///
    /// # Errors
    /// [`NotConverged`]; the rod keeps the shape that it had.
    pub fn settle(&mut self, clamp: &Clamp, forces: &[Force], springs: &[Spring]) -> Result<usize, NotConverged> {
        self.kept.copy_from_slice(&self.x);
        self.x[0] = clamp.place;
        let mut last = f64::INFINITY;
        for iteration in 1..=MOST_ITERATIONS {
            self.linearise(clamp, forces, springs);
            self.solve();
            last = self.walk(clamp, forces, springs);
            if last <= CONVERGED * self.length() {
                return Ok(iteration);
            }
            if !last.is_finite() {
                break;
            }
        }
        self.x.copy_from_slice(&self.kept);
        Err(NotConverged { step_m: last })
    }

    /// U of some places of the vertices.
    fn potential(&self, x: &[Vector], clamp: &Clamp, forces: &[Force], springs: &[Spring]) -> f64 {
        let l = self.segment;
        let stretch = |a: &Vector, b: &Vector| (norm(minus(*b, *a)) - l).powi(2);
        let mut u = 0.5 * self.stretching / l * x.windows(2).map(|w| stretch(&w[0], &w[1])).sum::<f64>();
        let bend = |w: &[Vector]| square(std::array::from_fn(|k| w[0][k] - 2.0 * w[1][k] + w[2][k]));
        u += 0.5 * self.bending / l.powi(3) * x.windows(3).map(bend).sum::<f64>();
        let leaves: Vector = std::array::from_fn(|k| x[1][k] - x[0][k] - l * clamp.direction[k]);
        u += self.bending / l.powi(3) * square(leaves);
        let at = |arc: f64| {
            let (i, share) = self.between(arc);
            mixed(x[i], x[i + 1], share)
        };
        u += springs.iter().map(|s| 0.5 * s.stiffness * square(s.across(minus(at(s.arc), s.place)))).sum::<f64>();
        u - forces.iter().map(|f| dot(f.force, at(f.arc))).sum::<f64>()
    }

    /// Gradient and Hessian of U at the present shape, of x_1 to x_N.
    fn linearise(&mut self, clamp: &Clamp, forces: &[Force], springs: &[Spring]) {
        let l = self.segment;
        let n = self.x.len() - 1;
        self.gradient.fill(0.0);
        self.hessian.clear();
        let Self { x, gradient, hessian, .. } = self;
        let mut pull = |i: usize, v: Vector| {
            if i > 0 {
                (0..3).for_each(|k| gradient[3 * (i - 1) + k] += v[k]);
            }
        };
        for i in 0..n {
            let e = minus(x[i + 1], x[i]);
            let (length, t) = (norm(e), unit(e));
            let force = self.stretching / l * (length - l);
            pull(i + 1, t.map(|c| force * c));
            pull(i, t.map(|c| -force * c));
            let (axial, lateral) = (self.stretching / l, force / length);
            for r in 0..3 {
                for c in 0..3 {
                    let same = if r == c { 1.0 } else { 0.0 };
                    let value = axial * t[r] * t[c] + lateral * (same - t[r] * t[c]);
                    hessian.join(i, i + 1, [1.0, -1.0], (r, c), value);
                }
            }
        }
        let stiff = self.bending / l.powi(3);
        for i in 1..n {
            let kink: Vector = std::array::from_fn(|k| x[i - 1][k] - 2.0 * x[i][k] + x[i + 1][k]);
            let weights = [(i - 1, 1.0), (i, -2.0), (i + 1, 1.0)];
            for (a, wa) in weights {
                pull(a, kink.map(|c| stiff * wa * c));
                for (b, wb) in weights {
                    (0..3).for_each(|k| hessian.add(a, b, (k, k), stiff * wa * wb));
                }
            }
        }
        let leaves: Vector = std::array::from_fn(|k| x[1][k] - x[0][k] - l * clamp.direction[k]);
        pull(1, leaves.map(|c| 2.0 * stiff * c));
        (0..3).for_each(|k| hessian.add(1, 1, (k, k), 2.0 * stiff));
        let last = n - 1;
        let between = |arc: f64| {
            let i = ((arc / l).max(0.0) as usize).min(last);
            (i, arc / l - i as f64)
        };
        for spring in springs {
            let (i, share) = between(spring.arc);
            let f = spring.force(mixed(x[i], x[i + 1], share));
            let weights = [1.0 - share, share];
            (0..2).for_each(|j| pull(i + j, f.map(|c| -weights[j] * c)));
            for r in 0..3 {
                for c in 0..3 {
                    let same = if r == c { 1.0 } else { 0.0 };
                    let value = spring.stiffness * (same - spring.axis[r] * spring.axis[c]);
                    hessian.join(i, i + 1, weights, (r, c), value);
                }
            }
        }
        for force in forces {
            let (i, share) = between(force.arc);
            pull(i, force.force.map(|c| -(1.0 - share) * c));
            pull(i + 1, force.force.map(|c| -share * c));
        }
    }

    /// Newton's step, with the least of a row of shifts that makes the Hessian positive definite.
    fn solve(&mut self) {
        let scale = self.bending / self.segment.powi(3);
        let mut shift = 0.0;
        loop {
            self.factor.copy_from(&self.hessian, shift);
            if self.factor.factorise() {
                break;
            }
            shift = if shift == 0.0 { 1e-6 * scale } else { 10.0 * shift };
            if !shift.is_finite() {
                break;
            }
        }
        self.step.iter_mut().zip(&self.gradient).for_each(|(s, g)| *s = -g);
        self.factor.solve(&mut self.step);
    }

    /// Goes along the step as far as the potential falls, and says how far the farthest vertex has gone, m.
    fn walk(&mut self, clamp: &Clamp, forces: &[Force], springs: &[Spring]) -> f64 {
        if self.step.iter().any(|x| !x.is_finite()) {
            return f64::INFINITY;
        }
        let longest = self.step.chunks(3).map(|s| norm([s[0], s[1], s[2]])).fold(0.0, f64::max);
        let apart = |i: usize| (0..3).map(|k| (self.step[i + k] - self.step[i + k - 3]).powi(2)).sum::<f64>().sqrt();
        let first = norm([self.step[0], self.step[1], self.step[2]]);
        let steepest = (3..self.step.len()).step_by(3).map(apart).fold(first, f64::max);
        let before = self.potential(&self.x, clamp, forces, springs);
        let mut share = (LONGEST_STEP * self.segment / steepest).min(1.0);
        for _ in 0..HALVINGS {
            self.trial[0] = self.x[0];
            for (i, step) in self.step.chunks(3).enumerate() {
                self.trial[i + 1] = std::array::from_fn(|k| self.x[i + 1][k] + share * step[k]);
            }
            let after = self.potential(&self.trial, clamp, forces, springs);
            // what rounding makes of a potential is no rise
            if after <= before + 1e-12 * before.abs() || share * longest <= CONVERGED * self.length() {
                std::mem::swap(&mut self.x, &mut self.trial);
                return share * longest;
            }
            share *= 0.5;
        }
        share * longest
    }
}

fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn minus(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|k| a[k] - b[k])
}

fn mixed(a: Vector, b: Vector, share: f64) -> Vector {
    std::array::from_fn(|k| (1.0 - share) * a[k] + share * b[k])
}

fn square(a: Vector) -> f64 {
    dot(a, a)
}

fn norm(a: Vector) -> f64 {
    square(a).sqrt()
}

fn unit(a: Vector) -> Vector {
    let length = norm(a);
    a.map(|x| x / length)
}

/// A vector turned as the shortest rotation turns one unit vector into another, which is not its opposite (Rodrigues).
fn turned(v: Vector, from: Vector, to: Vector) -> Vector {
    let (axis, cosine) = (cross(from, to), dot(from, to));
    let (swept, along) = (cross(axis, v), dot(axis, v) / (1.0 + cosine));
    std::array::from_fn(|k| cosine * v[k] + swept[k] + along * axis[k])
}
