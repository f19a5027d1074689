//! The wearer's parameters and how they were identified.

use super::Store;
use crate::pipeline::tissue::{Identified, Tissue};
use crate::storage::StorageError;
use crate::storage::records::IdentifiedRecord;
use embedded_storage_async::nor_flash::MultiwriteNorFlash;

impl<F: MultiwriteNorFlash> Store<F> {
    /// Replaces the parameters and how they were identified. After a loss of power, either both are old or both are new: how the
    /// new parameters were identified is first written to the part of the record that does not belong to the old ones.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn put_tissue(&mut self, tissue: &Tissue, identified: Option<Identified>) -> Result<(), StorageError> {
        let stored_id = self.get::<Tissue>(0).await?.map_or(0, |stored| stored.id);
        let part_in_force = self.identified(stored_id).await?.map_or(0, |(part, _)| part);
        let part = part_in_force ^ u8::from(tissue.id != stored_id);
        self.put(part, &IdentifiedRecord { tissue_id: tissue.id, identified }).await?;
        self.put(0, tissue).await
    }

    /// The stored parameters and how they were identified; [`Tissue::NONE`] without any.
    ///
    /// # Errors
    /// See [`StorageError`].
    pub async fn tissue(&mut self) -> Result<(Tissue, Option<Identified>), StorageError> {
        let tissue = self.get::<Tissue>(0).await?.unwrap_or(Tissue::NONE);
        let identified = self.identified(tissue.id).await?.and_then(|(_, identified)| identified);
        Ok((tissue, identified))
    }

    /// The part of [`IdentifiedRecord`] that belongs to these parameters, and how they were identified; `None` if no part does.
    async fn identified(&mut self, tissue_id: u32) -> Result<Option<(u8, Option<Identified>)>, StorageError> {
        for part in [0, 1] {
            let record = self.get::<IdentifiedRecord>(part).await?.filter(|record| record.tissue_id == tissue_id);
            if let Some(record) = record {
                return Ok(Some((part, record.identified)));
            }
        }
        Ok(None)
    }
}
