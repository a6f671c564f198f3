//! Copies of a state that allocate nothing.

/// Declares a struct whose `clone_from` is that of its fields, so that vectors keep their memory. (Derived, it would be a new
/// `clone`.) Fields are named once.
///
/// ```
/// mtled::cloned_field_by_field! {
///     struct Slip {
///         way_m: Vec<f64>,
///     }
/// }
/// let now = Slip { way_m: vec![1e-3; 3] };
/// let mut kept = Slip { way_m: vec![0.0; 3] };
/// kept.clone_from(&now); // the vector keeps its memory
/// assert_eq!(kept.way_m, now.way_m);
/// ```
#[macro_export]
macro_rules! cloned_field_by_field {
    (
        $(#[$attribute:meta])*
        $visibility:vis struct $name:ident {
            $($(#[$field_attribute:meta])* $field_visibility:vis $field:ident: $type:ty,)*
        }
    ) => {
        $(#[$attribute])*
        $visibility struct $name {
            $($(#[$field_attribute])* $field_visibility $field: $type,)*
        }

        impl Clone for $name {
            fn clone(&self) -> Self {
                Self { $($field: self.$field.clone(),)* }
            }

            fn clone_from(&mut self, other: &Self) {
                $(self.$field.clone_from(&other.$field);)*
            }
        }
    };
}
pub(super) use cloned_field_by_field;
