//! The engine: stages as async tasks joined by bounded channels, their work on a fixed set of threads.
//!
//! It knows nothing of meshes. A *parcel* carries one item through the stages; whatever happens to it, one
//! *outcome* per parcel reaches the end. At most as many parcels are under way as there are workers, and of no more weight
//! than a budget, so that what has started is finished before the next begins and memory stays bounded.
//!
//! ```text
//! intake ─► stage ─► stage ─► … ─► outcomes       tokio tasks, bounded channels
//!             │        │
//!             └────────┴── workers                threads, fed by a bounded crossbeam channel
//! ```
//! - [`admission`]: which parcels are let in
//! - [`workers`]: the threads
//! - [`stage`]: one task of the chain
//! - [`events`]: what was computed and what was reused

pub mod admission;
pub mod events;
pub mod stage;
pub mod workers;

pub use admission::{Admission, Admitted, Place};
pub use events::{Event, EventSink};
pub use stage::{Outcome, Parcel, Stage};
pub use workers::{Panicked, Workers};
