//! Transport between polygons against closed forms, invariants and a second,
//! slower computation.

mod hard;
mod invariants;
mod methods;
mod reference;
