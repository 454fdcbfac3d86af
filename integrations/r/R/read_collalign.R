#' Confidence below which a pose is in doubt, as in collalign's own report.
DOUBT <- 0.95

#' Read an aligned collection
#'
#' @param folder Output folder of \code{collalign align}.
#' @param labels Optional path of a CSV file with a column \code{name} (the shapes' names, or their
#'   files') or, beside it, \code{file}, and further columns.
#' @return A list of class \code{collalign}:
#'   \item{coords}{p x 3 x n array of corresponding points in the common frame, as geomorph and Morpho take it;
#'     points are named by their label, specimens by name.}
#'   \item{shapes}{data frame: \code{name}, \code{file}, \code{confidence}, \code{doubt}, \code{reflected}, \code{group}
#'     (poses are comparable within a group), and the columns of \code{labels}.}
#'   \item{transforms}{4 x 4 x n array: file coordinates to the common frame.}
#'   \item{consensus}{p x 3 mean points.}
#'   \item{notes}{What must be known before the poses are trusted.}
#'   \item{excluded}{What was left out, and why.}
#' @examples
#' \dontrun{
#' aligned <- read_collalign("OUT", labels = "labels.csv")
#' fit <- geomorph::gm.prcomp(aligned$coords[, , !aligned$shapes$doubt])
#' }
read_collalign <- function(folder, labels = NULL) {
  record <- read_record(folder)
  arrays <- read_npz(file.path(folder, "correspondences.npz"))
  wanted <- c("names", "labels", "positions", "consensus")
  if (!all(wanted %in% names(arrays))) stop(folder, ": correspondences.npz lacks ", setdiff(wanted, names(arrays))[1], call. = FALSE)
  shapes <- shape_table(record)
  if (!identical(shapes$name, arrays$names)) {
    stop(folder, ": alignment.json and correspondences.npz are of different runs", call. = FALSE)
  }
  if (!is.null(labels)) shapes <- with_labels(shapes, labels)
  structure(
    list(
      coords = label_order(arrays$positions, arrays$labels, shapes$name),
      shapes = shapes,
      transforms = transforms_of(record),
      consensus = arrays$consensus,
      notes = as.character(unlist(record$notes)),
      excluded = record$excluded
    ),
    class = "collalign"
  )
}

#' @param x,... An aligned collection; ignored.
#' @rdname read_collalign
print.collalign <- function(x, ...) {
  size <- dim(x$coords)
  cat(sprintf("%d aligned shapes, %d corresponding points\n", size[3], size[1]))
  doubted <- x$shapes$name[x$shapes$doubt]
  if (length(doubted)) cat("in doubt:", paste(doubted, collapse = ", "), "\n")
  if (length(x$notes)) cat(paste0("note: ", x$notes, "\n"), sep = "")
  invisible(x)
}

read_record <- function(folder) {
  file <- file.path(folder, "alignment.json")
  if (!file.exists(file)) stop(folder, ": no alignment.json in it; name the output folder of collalign align", call. = FALSE)
  jsonlite::fromJSON(file, simplifyVector = FALSE)
}

shape_table <- function(record) {
  field <- function(key, missing) {
    vapply(record$shapes, function(shape) if (is.null(shape[[key]])) missing else shape[[key]], missing)
  }
  confidence <- vapply(record$shapes, function(s) if (is.null(s$confidence)) NA_real_ else as.numeric(s$confidence), 0)
  name <- field("name", "")
  group <- integer(length(name))
  for (number in seq_along(record$groups)) group[name %in% unlist(record$groups[[number]])] <- number
  data.frame(
    name = name, file = field("file", ""), confidence = confidence,
    doubt = is.na(confidence) | confidence < DOUBT, reflected = field("reflected", NA), group = group
  )
}

with_labels <- function(shapes, file) {
  table <- utils::read.csv(file, check.names = FALSE, colClasses = "character")
  if (!"name" %in% names(table)) stop(file, ": no column 'name'", call. = FALSE)
  row <- match(shapes$name, shape_name(table$name))
  if ("file" %in% names(table)) row <- ifelse(is.na(row), match(shapes$name, shape_name(table$file)), row)
  unknown <- table$name[setdiff(seq_len(nrow(table)), row)]
  if (length(unknown)) warning(file, ": no aligned shape is called ", some(unknown), call. = FALSE)
  if (anyNA(row)) warning(file, ": there is no row for ", some(shapes$name[is.na(row)]), call. = FALSE)
  cbind(shapes, table[row, !names(table) %in% c("name", "file"), drop = FALSE], row.names = NULL)
}

# As `collalign align --labels` reads names: without folder, without the ending of a mesh or point file.
shape_name <- function(text) {
  name <- basename(gsub("\\\\", "/", trimws(text)))
  sub("\\.(ply|obj|stl|off|vtk|vtp|xyz|npz|npy)$", "", name, ignore.case = TRUE)
}

some <- function(names) {
  shown <- paste(utils::head(names, 5), collapse = ", ")
  if (length(names) > 5) sprintf("%s and %d more", shown, length(names) - 5L) else shown
}

transforms_of <- function(record) {
  matrices <- lapply(record$shapes, function(s) do.call(rbind, lapply(s$transform, as.numeric)))
  array(unlist(matrices), c(4, 4, length(matrices)))
}

# positions: n x k x 3 by sample; labels: n x k, from 0. Returned: k x 3 x n by label.
label_order <- function(positions, labels, names) {
  size <- dim(positions)
  coords <- array(NA_real_, c(size[2], 3L, size[1]), list(seq_len(size[2]) - 1L, c("X", "Y", "Z"), names))
  for (i in seq_len(size[1])) coords[labels[i, ] + 1, , i] <- positions[i, , ]
  coords
}
