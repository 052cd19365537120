//! One stage of the chain: a task that takes parcels, has them worked on, and passes them on.

use std::sync::Arc;

use tokio::sync::mpsc;
use tokio::task::JoinSet;

use super::admission::Admitted;
use super::workers::Workers;

/// Parcels that wait between two stages.
const WAITING: usize = 1;

/// An item on its way: what it is now, and which item it is.
#[derive(Debug)]
pub struct Parcel<T> {
    /// The number of the item, in the order of intake.
    pub item: usize,
    /// What the last stage made of it.
    pub load: T,
    /// Held until the item's outcome is known: bounds what is under way.
    pub admission: Admitted,
}

/// What became of an item.
#[derive(Debug)]
pub struct Outcome<T, E> {
    /// The number of the item.
    pub item: usize,
    /// What the last stage made of it, or why some stage could not.
    pub result: Result<T, E>,
}

/// The open end of a chain of stages.
pub struct Stage<T, End, E> {
    inbox: mpsc::Receiver<Parcel<T>>,
    outcomes: mpsc::UnboundedSender<Outcome<End, E>>,
    workers: Arc<Workers>,
    tasks: JoinSet<()>,
}

/// The outcomes, one an item: small reports that wait for whoever reads them.
pub type Outcomes<End, E> = mpsc::UnboundedReceiver<Outcome<End, E>>;

impl<T, End, E> Stage<T, End, E>
where
    T: Send + 'static,
    End: Send + 'static,
    E: Send + From<super::Panicked> + 'static,
{
    /// Begins a chain: parcels sent into the returned channel reach the first stage.
    pub fn begin(workers: Arc<Workers>) -> (mpsc::Sender<Parcel<T>>, Self, Outcomes<End, E>) {
        let (intake, inbox) = mpsc::channel(WAITING);
        let (outcomes, results) = mpsc::unbounded_channel();
        (intake, Self { inbox, outcomes, workers, tasks: JoinSet::new() }, results)
    }

    /// Adds a stage. `work` runs on the workers, on several parcels at once where there are several.
    pub fn then<Next: Send + 'static>(
        self,
        work: impl Fn(usize, T) -> Result<Next, E> + Send + Sync + 'static,
    ) -> Stage<Next, End, E> {
        let (forward, inbox) = mpsc::channel(WAITING);
        let Self { inbox: mut parcels, outcomes, workers, mut tasks } = self;
        let (results, crew, work) = (outcomes.clone(), workers.clone(), Arc::new(work));
        tasks.spawn(async move {
            let mut under_way = JoinSet::new();
            while let Some(parcel) = parcels.recv().await {
                while under_way.try_join_next().is_some() {}
                let (crew, work) = (crew.clone(), work.clone());
                let (forward, results) = (forward.clone(), results.clone());
                under_way.spawn(async move {
                    let Parcel { item, load, admission } = parcel;
                    let worked = crew.run(move || work(item, load)).await;
                    match worked.unwrap_or_else(|panicked| Err(panicked.into())) {
                        // A closed channel means that the run is being abandoned.
                        Ok(load) => drop(forward.send(Parcel { item, load, admission }).await),
                        Err(error) => drop(results.send(Outcome { item, result: Err(error) })),
                    }
                });
            }
            while under_way.join_next().await.is_some() {}
        });
        Stage { inbox, outcomes, workers, tasks }
    }
}

impl<End, E> Stage<End, End, E>
where
    End: Send + 'static,
    E: Send + From<super::Panicked> + 'static,
{
    /// Ends the chain: what the last stage made is the item's outcome. Returns the tasks, which finish when the
    /// intake is dropped and every parcel has its outcome.
    pub fn end(self) -> JoinSet<()> {
        let Self { mut inbox, outcomes, workers: _, mut tasks } = self;
        tasks.spawn(async move {
            while let Some(Parcel { item, load, .. }) = inbox.recv().await {
                // Nobody reads outcomes any more when the run is being abandoned.
                let _ = outcomes.send(Outcome { item, result: Ok(load) });
            }
        });
        tasks
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::Admission;
    use std::num::NonZeroUsize;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Debug, PartialEq)]
    struct Fault(String);

    impl From<super::super::Panicked> for Fault {
        fn from(panicked: super::super::Panicked) -> Self {
            Self(panicked.message)
        }
    }

    #[tokio::test]
    async fn every_item_has_one_outcome_and_few_are_under_way() {
        let workers = Arc::new(Workers::start(NonZeroUsize::new(3).unwrap()).unwrap());
        let admitted = Admission::new(NonZeroUsize::new(3).unwrap(), u64::MAX);
        let (under_way, most) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let (intake, first, mut outcomes) = Stage::<usize, String, Fault>::begin(workers);
        let (entering, leaving, peak) = (under_way.clone(), under_way.clone(), most.clone());
        let tasks = first
            .then(move |_, x: usize| {
                peak.fetch_max(entering.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                match x {
                    13 => Err(Fault("unlucky".into())),
                    17 => panic!("out of luck"),
                    _ => Ok(2 * x),
                }
            })
            .then(move |item, x| {
                leaving.fetch_sub(1, Ordering::SeqCst);
                Ok(format!("{item}: {x}"))
            })
            .end();
        let feeder = tokio::spawn(async move {
            for item in 0..40 {
                let admission = admitted.admit(1).await;
                intake.send(Parcel { item, load: item, admission }).await.unwrap();
            }
        });
        let mut results: Vec<Option<Result<String, String>>> = vec![None; 40];
        while let Some(Outcome { item, result }) = outcomes.recv().await {
            assert!(results[item].is_none());
            results[item] = Some(result.map_err(|fault| fault.0));
        }
        feeder.await.unwrap();
        tasks.join_all().await;
        assert_eq!(results[13], Some(Err("unlucky".into())));
        assert_eq!(results[17], Some(Err("out of luck".into())));
        assert_eq!(results[20], Some(Ok("20: 40".into())));
        assert!(results.iter().all(Option::is_some));
        // The two that failed never left.
        assert!(most.load(Ordering::SeqCst) <= 3 + 2, "{most:?}");
    }
}
