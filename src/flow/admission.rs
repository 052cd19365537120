//! Who may be under way: so many items at once, and of no more weight in all than a budget.
//!
//! What a weight is, the caller says; bytes of memory, usually. An item that is heavier than the whole budget is let in when
//! nothing else is under way. Items are let in in the order in which they ask, so that a heavy one is not overtaken for
//! ever by light ones.

use std::num::NonZeroUsize;
use std::sync::Arc;

use tokio::sync::{OwnedSemaphorePermit, Semaphore};

/// Lets items in.
#[derive(Debug, Clone)]
pub struct Admission {
    places: Arc<Semaphore>,
    weights: Arc<Semaphore>,
    /// What one permit of `weights` stands for.
    unit: u64,
    /// The permits of the whole budget.
    all: u32,
}

/// Held by an item that is under way.
#[derive(Debug)]
pub struct Admitted {
    _place: OwnedSemaphorePermit,
    _weight: OwnedSemaphorePermit,
}

/// A place for one item, which is chosen only now.
#[derive(Debug)]
pub struct Place {
    place: OwnedSemaphorePermit,
    admission: Admission,
}

impl Place {
    /// Waits until an item of this `weight` may be under way.
    pub async fn weighing(self, weight: u64) -> Admitted {
        let Admission { weights, unit, all, .. } = &self.admission;
        let permits = weight.div_ceil(*unit).min(u64::from(*all)) as u32;
        let weight = weights.clone().acquire_many_owned(permits).await.expect(CLOSED);
        Admitted { _place: self.place, _weight: weight }
    }
}

const CLOSED: &str = "nobody closes these semaphores";

/// The parts into which a budget is divided.
const PARTS: u64 = 1 << 20;

impl Admission {
    /// For at most `count` items that weigh at most `budget` in all.
    pub fn new(count: NonZeroUsize, budget: u64) -> Self {
        let unit = budget.div_ceil(PARTS).max(1);
        let all = (budget / unit).clamp(1, PARTS) as u32;
        Self {
            places: Arc::new(Semaphore::new(count.get())),
            weights: Arc::new(Semaphore::new(all as usize)),
            unit,
            all,
        }
    }

    /// Waits until there is a place.
    pub async fn place(&self) -> Place {
        let place = self.places.clone().acquire_owned().await.expect(CLOSED);
        Place { place, admission: self.clone() }
    }

    /// Waits until there is a place, and then until an item of this `weight` may be under way.
    #[cfg(test)]
    pub async fn admit(&self, weight: u64) -> Admitted {
        self.place().await.weighing(weight).await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::time::Duration;

    /// Lets items of these weights in one after the other, each for a moment; the order in which they began, and the most
    /// items and weight that were ever under way.
    async fn pass(count: usize, budget: u64, weights: &[u64]) -> (Vec<usize>, usize, u64) {
        let admission = Admission::new(NonZeroUsize::new(count).unwrap(), budget);
        let under_way = Arc::new(Mutex::new((0, 0)));
        let (mut order, mut most, mut heaviest) = (Vec::new(), 0, 0);
        let mut tasks = tokio::task::JoinSet::new();
        for (item, &weight) in weights.iter().enumerate() {
            let admitted = admission.admit(weight).await;
            order.push(item);
            {
                let mut now = under_way.lock().unwrap();
                *now = (now.0 + 1, now.1 + weight);
                (most, heaviest) = (most.max(now.0), heaviest.max(now.1));
            }
            let under_way = under_way.clone();
            tasks.spawn(async move {
                tokio::time::sleep(Duration::from_millis(1 + item as u64 % 3)).await;
                let mut now = under_way.lock().unwrap();
                *now = (now.0 - 1, now.1 - weight);
                drop(admitted);
            });
        }
        tasks.join_all().await;
        (order, most, heaviest)
    }

    #[tokio::test]
    async fn no_more_is_under_way_than_the_budget_and_nobody_is_overtaken() {
        let weights: Vec<u64> = (0..60).map(|i| if i % 7 == 0 { 90 } else { 10 + i % 5 }).collect();
        let (order, most, heaviest) = pass(8, 100, &weights).await;
        assert_eq!(order, (0..60).collect::<Vec<_>>());
        assert!(heaviest <= 100, "{heaviest}");
        assert!((2..=8).contains(&most), "{most}");
    }

    #[tokio::test]
    async fn what_is_heavier_than_the_budget_is_alone() {
        let (order, most, heaviest) = pass(4, 100, &[500, 1, 500, 500]).await;
        assert_eq!((order, most, heaviest), (vec![0, 1, 2, 3], 1, 500));
    }

    #[tokio::test]
    async fn light_items_are_bounded_by_their_number_and_budgets_may_be_huge_or_nothing() {
        assert_eq!(pass(3, u64::MAX, &[1; 20]).await.1, 3);
        assert_eq!(pass(3, 64 << 30, &[1 << 30; 20]).await.1, 3);
        assert_eq!(pass(3, 0, &[1; 5]).await.1, 1);
        // Without weight there is nothing to wait for.
        assert_eq!(pass(3, 0, &[0; 20]).await.1, 3);
    }
}
