//! A check of Parquet pages before they are decoded. The Parquet library allocates memory for as many values as the header of a
//! page claims, so a damaged header could exhaust the memory.

use parquet::column::page::{Page, PageMetadata, PageReader};
use parquet::errors::{ParquetError, Result};

/// Reads the pages of a column and rejects pages that claim more values than they can hold.
pub struct CheckedPages {
    /// The unchecked pages of the column.
    pub pages: Box<dyn PageReader>,
    /// Number of rows in the row group.
    pub rows: usize,
    /// Size of a value of the column, bytes.
    pub value_bytes: usize,
}

impl PageReader for CheckedPages {
    fn get_next_page(&mut self) -> Result<Option<Page>> {
        let page = self.pages.get_next_page()?;
        let most_values = match &page {
            Some(Page::DictionaryPage { buf, .. }) => buf.len() / self.value_bytes,
            _ => self.rows,
        };
        match page.as_ref().map_or(0, Page::num_values) as usize {
            values if values > most_values => {
                Err(ParquetError::General(format!("{values} values in a page, at most {most_values} fit")))
            }
            _ => Ok(page),
        }
    }

    fn peek_next_page(&mut self) -> Result<Option<PageMetadata>> {
        self.pages.peek_next_page()
    }

    fn skip_next_page(&mut self) -> Result<()> {
        self.pages.skip_next_page()
    }
}

impl Iterator for CheckedPages {
    type Item = Result<Page>;

    fn next(&mut self) -> Option<Self::Item> {
        self.get_next_page().transpose()
    }
}
