#' Confidence below which a pose is in doubt, as in collalign's own report.
DOUBT <- 0.95

# Columns that may hold the shapes' names, the first found counts, as for `collalign align --labels`.
NAME_COLUMNS <- c("name", "shape", "specimen", "id", "file")

#' Read an aligned collection
#'
#' @param folder Output folder of \code{collalign align}.
#' @param labels Optional path of a CSV file with a column of the shapes' names, or their files', and further columns.
#'   It is called \code{name}, \code{shape}, \code{specimen}, \code{id} or \code{file}, or is the first.
#' @return A list of class \code{collalign}:
#'   \item{coords}{p x 3 x n array of corresponding points as geomorph and Morpho take it: turned, and where
#'     \code{reflected} mirrored, to the common frame, in the unit of each file, so that size is kept;
#'     points are named by their label, specimens by name; NA where an incomplete shape has no such point.}
#'   \item{shapes}{data frame: \code{name}, \code{file}, \code{confidence}, \code{doubt}, \code{reflected}, \code{centroid_size}
#'     (of \code{coords}, in the unit of each file, as in collalign's tables), \code{group}
#'     (poses are comparable within a group), \code{incomplete}, and the columns of \code{labels}.}
#'   \item{transforms}{4 x 4 x n array: file coordinates to the common frame.}
#'   \item{consensus}{p x 3 mean points in the common frame, where sizes are made alike.}
#'   \item{notes}{What must be known before the poses are trusted.}
#'   \item{excluded}{What was left out, and why.}
#' @examples
#' \dontrun{
#' aligned <- read_collalign("OUT", labels = "labels.csv")
#' fit <- geomorph::gm.prcomp(aligned$coords[, , !aligned$shapes$doubt & !aligned$shapes$incomplete])
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
  transforms <- transforms_of(record)
  coords <- in_file_units(label_order(arrays$positions, arrays$labels, shapes$name), transforms)
  shapes$centroid_size <- centroid_sizes(coords)
  if (!is.null(labels)) shapes <- with_labels(shapes, labels)
  structure(
    list(
      coords = coords,
      shapes = shapes,
      transforms = transforms,
      consensus = arrays$consensus,
      notes = vapply(record$notes, function(note) note$text, ""),
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
    doubt = is.na(confidence) | confidence < DOUBT, reflected = field("reflected", NA), group = group,
    incomplete = name %in% vapply(record$incomplete, function(one) one$name, "")
  )
}

with_labels <- function(shapes, file) {
  table <- label_table(file)
  columns <- tolower(trimws(names(table)))
  key <- c(match(NAME_COLUMNS, columns), 1L)
  key <- c(key[!is.na(key)][1], which(columns == "file"))
  row <- rep(NA_integer_, nrow(shapes))
  for (column in key) row <- ifelse(is.na(row), match(shapes$name, shape_name(table[[column]])), row)
  unknown <- table[[key[1]]][setdiff(seq_len(nrow(table)), row)]
  if (length(unknown)) warning(file, ": no aligned shape is called ", some(unknown), call. = FALSE)
  if (anyNA(row)) warning(file, ": there is no row for ", some(shapes$name[is.na(row)]), call. = FALSE)
  cbind(shapes, lapply(table[row, -key, drop = FALSE], as_numbers), row.names = NULL)
}

# Commas, semicolons or tabs between columns, in UTF-8 or as Excel writes it on Windows.
label_table <- function(file) {
  text <- readLines(file, warn = FALSE)
  if (!all(validUTF8(text))) text <- iconv(text, "CP1252", "UTF-8")
  Encoding(text) <- "UTF-8"
  text[1] <- sub("^\ufeff", "", text[1])
  signs <- c(",", ";", "\t")
  counts <- vapply(signs, function(sign) length(strsplit(text[1], sign, fixed = TRUE)[[1]]), 0L)
  utils::read.csv(
    text = text, sep = signs[which.max(counts)], check.names = FALSE, colClasses = "character", encoding = "UTF-8"
  )
}

# A column of numbers as such, with decimal points or commas.
as_numbers <- function(column) {
  known <- column[!column %in% c("", "NA", NA)]
  is_number <- grepl("^[+-]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eE][+-]?[0-9]+)?$", known)
  if (!length(known) || !all(is_number)) return(column)
  column[!column %in% known] <- NA
  as.numeric(sub(",", ".", column, fixed = TRUE))
}

# As `collalign align --labels` reads names: without folder, without the ending of a mesh or point file.
shape_name <- function(text) {
  name <- basename(gsub("\\\\", "/", trimws(text)))
  sub("\\.(ply|obj|stl|off|glb|gltf|vtk|vtp|pcd|pts|xyz|asc|txt|csv|npz)$", "", name, ignore.case = TRUE)
}

some <- function(names) {
  shown <- paste(utils::head(names, 5), collapse = ", ")
  if (length(names) > 5) sprintf("%s and %d more", shown, length(names) - 5L) else shown
}

transforms_of <- function(record) {
  matrices <- lapply(record$shapes, function(s) do.call(rbind, lapply(s$transform, as.numeric)))
  array(unlist(matrices), c(4, 4, length(matrices)))
}

# positions: n x k x 3 by sample; labels: n x k, from 0, -1 where an incomplete shape's sample has none.
# Returned: k x 3 x n by label.
label_order <- function(positions, labels, names) {
  size <- dim(positions)
  coords <- array(NA_real_, c(size[2], 3L, size[1]), list(seq_len(size[2]) - 1L, c("X", "Y", "Z"), names))
  for (i in seq_len(size[1])) {
    known <- labels[i, ] >= 0
    coords[labels[i, known] + 1, , i] <- positions[i, known, ]
  }
  coords
}

# The common frame may be scaled: each specimen's factor is taken out again, its rotation and reflection stay.
in_file_units <- function(coords, transforms) {
  scale <- apply(transforms[1:3, 1:3, , drop = FALSE], 3, function(linear) abs(det(linear))^(1 / 3))
  sweep(coords, 3, scale, "/")
}

# Square root of the summed squared distances of a specimen's points from their centroid.
centroid_sizes <- function(coords) {
  unname(apply(coords, 3, function(points) {
    known <- points[stats::complete.cases(points), , drop = FALSE]
    sqrt(sum(sweep(known, 2, colMeans(known))^2))
  }))
}
