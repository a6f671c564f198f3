//! The undeformed state of a model.

use super::adaptive_damping::AdaptiveDamping;
use super::contact::{Surface, Touch};
use super::disjoint::NODES_PER_CHUNK;
use super::drag::Drag;
use super::half::Half;
use super::inertia::{Motion, Sums};
use super::kernel::{Kernel, Points};
use super::memory::Memory;
use super::model::{Model, Precise, with_kernel};
use super::state::{Constraints, Control, Moving, Path, Role, State, Tangent};

/// What an undeformed state has that is not zero.
#[derive(Debug)]
pub(super) struct Rest {
    pub control: Control,
    pub role: Vec<Role>,
    pub instrument: Option<Surface>,
    pub base: Option<Surface>,
    pub drag: Drag,
    memory: Vec<Memory>,
}

impl Rest {
    /// Of no mass yet.
    pub(super) fn new(kernel: &Precise<Kernel<f32>, Kernel<f64>>, role: Vec<Role>, half: Option<&Half>) -> Self {
        let nodes = role.len();
        let control = Control {
            mass: vec![0.0; nodes],
            slowest: 0.0,
            light: false,
            faster: 1.0,
            probe: noise(&role, half),
            largest: 0.0,
            since_refresh: 0.0,
            usual_travel: 0.0,
            motion: Motion::default(),
            damping: AdaptiveDamping::default(),
            sums: vec![Sums::default(); nodes.div_ceil(NODES_PER_CHUNK)],
            dragged: Sums::default(),
        };
        let drag = Drag::new([0.0, 0.0, -1.0], (Vec::new(), Vec::new()), &[], Vec::new(), 1.0);
        let memory = with_kernel!((kernel) => (k) { k.memory() });
        Self { control, role, instrument: None, base: None, drag, memory }
    }

    /// The same body of other materials, of no mass yet.
    pub(super) fn of_materials(&self, kernel: &Precise<Kernel<f32>, Kernel<f64>>, half: Option<&Half>) -> Self {
        let (instrument, base, drag) = (self.instrument, self.base, self.drag.clone());
        Self { instrument, base, drag, ..Self::new(kernel, self.role.clone(), half) }
    }
}

impl Model {
    /// The undeformed state.
    pub(super) fn undeformed(&self) -> State {
        let rest = &self.rest;
        let nodes = rest.role.len();
        let zero = vec![[0.0; 3]; nodes];
        State {
            moving: Moving {
                u: zero.clone(),
                q: zero.clone(),
                tangent: Tangent([0, 1, 2].map(|_| zero.clone())),
                f: zero,
                mass_factor: 1.0,
                time: None,
                memory: rest.memory.clone(),
                touch: vec![Touch::default(); nodes],
                offset: [0.0; 3],
                slip: rest.drag.slip(),
            },
            control: rest.control.clone(),
            constraints: Constraints {
                role: rest.role.clone(),
                path: vec![Path::default(); nodes],
                instrument: rest.instrument,
                way: Path::default(),
                base: rest.base,
                drag: rest.drag.clone(),
            },
            points: match &self.kernel {
                Precise::F32(k) => Precise::<Points<f32>, Points<f64>>::F32(k.points()),
                Precise::F64(k) => Precise::F64(k.points()),
            },
        }
    }

    /// Brings a state back to that; allocates nothing.
    pub(super) fn undeform(&self, state: &mut State) {
        let rest = &self.rest;
        let State { moving, control, constraints, points } = state;
        let Moving { u, q, tangent, f, mass_factor, time, memory, touch, offset, slip } = moving;
        [u, q, f].into_iter().chain(&mut tangent.0).for_each(|field| field.fill([0.0; 3]));
        touch.fill(Touch::default());
        memory.clone_from(&rest.memory);
        slip.forget();
        (*mass_factor, *time, *offset) = (1.0, None, [0.0; 3]);
        control.clone_from(&rest.control);
        constraints.role.clone_from(&rest.role);
        constraints.path.fill(Path::default());
        (constraints.instrument, constraints.way, constraints.base) = (rest.instrument, Path::default(), rest.base);
        constraints.drag.clone_from(&rest.drag);
        with_kernel!((points) => (points) { points.fill() });
    }
}

/// A fixed vector with no symmetry but the body's own, zero on held nodes.
fn noise(role: &[Role], half: Option<&Half>) -> Vec<[f64; 3]> {
    let value = |i: usize| ((i.wrapping_mul(2_654_435_761) >> 7) % 1009) as f64 / 1009.0 - 0.5;
    let free = |(i, r): (usize, &Role)| {
        let v = std::array::from_fn(|k| if r.frees(k) { value(3 * i + k) } else { 0.0 });
        half.map_or(v, |half| half.of_node(i, v))
    };
    role.iter().enumerate().map(free).collect()
}
