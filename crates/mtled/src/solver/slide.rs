//! Springs with a limit, at the end of a step: what a rod's wall and end do to the material (see [`super::drag`]).
//!
//! The return mapping of an elastic and perfectly plastic bar (Simo and Hughes, Computational Inelasticity, 1998, section 1.4): stable
//! however stiff, and each slip dissipates P db >= 0.

/// A ring of the end: its springs, its limit, and how far a force within a step moves the tissue, m/N.
pub(super) struct Tip {
    /// N/m
    pub spring: f64,
    /// Beyond the limit, N/m.
    pub stiff: f64,
    /// N
    pub limit: f64,
    /// m/N
    pub compliance: f64,
}

impl Tip {
    /// How far a force moves spring and tissue together within a step, m/N.
    pub(super) fn give(&self) -> f64 {
        1.0 / self.spring + self.compliance
    }

    /// Push at the end of a step, N, from d - c - w without it, m.
    pub(super) fn force(&self, gap: f64) -> f64 {
        let Self { spring, stiff, limit, compliance } = *self;
        let soft = spring * gap / (1.0 + spring * compliance);
        let beyond = stiff * (gap - limit * (1.0 / spring + compliance)) / (1.0 + stiff * compliance);
        if soft < limit { soft.max(0.0) } else { limit + beyond.max(0.0) }
    }
}

/// How the limit of what cuts grows with its speed: l max(1, (v / v_0)^n), v = x / t for a way x within a time t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rate {
    /// n, 0 to 1; 0: not at all.
    pub exponent: f64,
    /// v_0 t, m: the way up to which the limit is l; infinite where the time is not known.
    pub slow: f64,
}

impl Default for Rate {
    fn default() -> Self {
        Self { exponent: 0.0, slow: f64::INFINITY }
    }
}

/// Relative change of a way at which it is found, and most tries.
const FOUND: f64 = 1e-12;
const TRIES: u32 = 50;

impl Rate {
    /// The way x of what cuts, m, where its push P is at the limit; P is l at the way `constant` > v_0 t, and falls with `stiffness` in
    /// N/m.
    /// With y = x / (v_0 t): P / l = most - fall y = y^n. The right side is concave, so Newton's steps from y = 1 come to the root from
    /// below.
    pub fn way(&self, constant: f64, limit: f64, stiffness: f64) -> f64 {
        let fall = stiffness * self.slow / limit;
        let most = 1.0 + fall * constant / self.slow;
        let mut y = 1.0;
        for _ in 0..TRIES {
            let power = f64::powf(y, self.exponent);
            let step = (most - fall * y - power) / (fall + self.exponent * power / y);
            y += step;
            if step <= FOUND * y {
                break;
            }
        }
        y * self.slow
    }
}

/// Force P of a wall at the end of a step and where its slip b then is. `gap`: way of the rod less that of the layer without the
/// wall's force; `heavy`: force per way that the layer makes of a force within a step, N/m.
pub(super) fn slide(spring: f64, limit: f64, heavy: f64, gap: f64, b: f64) -> (f64, f64) {
    let trial = spring * (gap - b) / (1.0 + spring / heavy);
    let force = trial.clamp(-limit, limit);
    // b where the spring is at its limit after the step
    let slipped = if force == trial { b } else { gap - force / heavy - force / spring };
    (force, slipped)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cuts_fast_is_at_its_limit() {
        let rate = Rate { exponent: 0.5, slow: 1e-6 };
        for (constant, limit, stiffness) in
            [(2e-6, 3e-3, 80.0), (4e-5, 3e-3, 80.0), (1e-3, 3e-3, 1e4), (1e-3, 3e-3, 1.0)]
        {
            let way = rate.way(constant, limit, stiffness);
            let push = limit + stiffness * (constant - way);
            let most = limit * (way / rate.slow).sqrt();
            assert!(
                (push / most - 1.0).abs() < 1e-9 && way > rate.slow && way < constant,
                "{way}: {push} N of {most} N"
            );
        }
    }

    /// A rod along a layer that elastic tissue holds and inertia slows down, moved to random places and back. No step of slip makes
    /// work, and the rod's work is at least what slip has dissipated and springs have stored.
    #[test]
    fn a_hundred_thousand_random_cycles_take_work() {
        let mut seed = 1_u64;
        let mut random = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        for _ in 0..1000 {
            let [spring, tissue, heavy] = [(); 3].map(|()| 10.0_f64.powf(5.0 * random() - 1.0));
            let limit = spring * 10.0_f64.powf(4.0 * random() - 3.0);
            let stored = |force: f64, w: f64| 0.5 * force * force / spring + 0.5 * tissue * w * w;
            let (mut d, mut w, mut b, mut force) = (0.0, 0.0, 0.0, 0.0);
            for cycle in 0..100 {
                let at_first = stored(force, w);
                let (mut work, mut dissipated) = (0.0, 0.0);
                for to in [random(), -random(), random(), 0.0] {
                    let way = (to - d) / 5.0;
                    for _ in 0..5 {
                        d += way;
                        let free = heavy * w / (heavy + tissue);
                        let (next, slipped) = slide(spring, limit, heavy + tissue, d - free, b);
                        let lost = next * (slipped - b);
                        assert!(next.abs() <= limit && lost >= -1e-12 * limit, "cycle {cycle}: {next} N, {lost} J");
                        (dissipated, work) = (dissipated + lost, work + next * way);
                        (b, force, w) = (slipped, next, free + next / (heavy + tissue));
                    }
                }
                let gained = stored(force, w) - at_first;
                let size = work.abs() + dissipated + at_first + gained.abs();
                assert!(work >= dissipated + gained - 1e-9 * size, "cycle {cycle}: {work} {dissipated} {gained} J");
            }
        }
    }
}
