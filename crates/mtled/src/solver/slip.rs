//! What nodes that a rod drags remember of it (see [`super::drag`]).

use super::cloned::cloned_field_by_field;
use super::drag::Drag;

cloned_field_by_field! {
    /// Slip: what a dragged body remembers.
    #[derive(Debug, Default)]
    pub(super) struct Slip {
        /// d, m.
        pub at: f64,
        /// b of each layer, m.
        pub wall: Vec<f64>,
        /// c_i of each ring, m.
        pub end: Vec<f64>,
        /// b that tissue which springs back does not undo, m.
        pub wall_floor: Vec<f64>,
        /// c_i that it does not undo, m.
        pub end_floor: Vec<f64>,
        /// c_i at the beginning of the time that [`super::End::rate`] is of, m.
        pub began: Vec<f64>,
        /// P of each layer, N, into the body on the tissue.
        pub pull: Vec<f64>,
        /// P_i, N.
        pub push: Vec<f64>,
        /// Whether a membrane held the end in the last step.
        pub stopped: bool,
        /// Work that slip has dissipated, J.
        pub dissipated: f64,
        /// Whether each node goes with the rod: it sticks to the wall or to the end.
        pub held: Vec<bool>,
        /// Way along the axis of each node in the present step, m.
        pub step: Vec<f64>,
        /// Force along the axis on each node, N.
        pub load: Vec<f64>,
    }
}

impl Slip {
    /// Force of the wall and of the end on the tissue that the model has, N, into the body.
    pub(super) fn forces(&self) -> [f64; 2] {
        [self.pull.iter().sum(), self.push.iter().sum()]
    }

    /// Nothing slipped; allocates nothing.
    pub(super) fn forget(&mut self) {
        let Self { at, wall, end, wall_floor, end_floor, began, pull, push, stopped, dissipated, held, step, load } =
            self;
        for numbers in [wall, end, wall_floor, end_floor, began, pull, push, step, load] {
            numbers.fill(0.0);
        }
        held.fill(false);
        (*at, *stopped, *dissipated) = (0.0, false, 0.0);
    }
}

impl Drag {
    /// Nothing slipped.
    pub(super) fn slip(&self) -> Slip {
        let (layers, rings) = (self.walls.len(), self.areas.len());
        Slip {
            wall: vec![0.0; layers],
            end: vec![0.0; rings],
            wall_floor: vec![0.0; layers],
            end_floor: vec![0.0; rings],
            began: vec![0.0; rings],
            pull: vec![0.0; layers],
            push: vec![0.0; rings],
            held: vec![false; self.nodes.len()],
            step: vec![0.0; self.nodes.len()],
            load: vec![0.0; self.nodes.len()],
            ..Slip::default()
        }
    }
}
