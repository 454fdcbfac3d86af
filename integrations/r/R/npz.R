# Arrays of NumPy's .npz archives: a zip of .npy files (numpy.org, "NEP 1: a simple file format for NumPy arrays").

#' Read the arrays of a NumPy archive
#'
#' Whole numbers, floating-point numbers, truth values and texts are read; nothing that could run code is.
#'
#' @param file Path of an .npz file.
#' @return A named list of arrays with the dimensions that NumPy shows.
read_npz <- function(file) {
  if (!file.exists(file)) stop(file, ": no such file", call. = FALSE)
  members <- tryCatch(utils::unzip(file, list = TRUE)$Name, error = function(e) character(), warning = function(w) character())
  if (!length(members)) stop(file, ": not a NumPy archive", call. = FALSE)
  arrays <- lapply(members, function(member) {
    connection <- unz(file, member, open = "rb")
    on.exit(close(connection))
    read_npy(connection, paste0(file, ": ", member))
  })
  stats::setNames(arrays, sub("\\.npy$", "", members))
}

read_npy <- function(connection, what) {
  magic <- readBin(connection, "raw", 8)
  if (length(magic) < 8 || !identical(magic[1:6], as.raw(c(0x93, 0x4e, 0x55, 0x4d, 0x50, 0x59)))) {
    stop(what, ": not a NumPy array", call. = FALSE)
  }
  size <- if (magic[7] == as.raw(1)) 2L else 4L
  length <- readBin(connection, "integer", 1, size = size, signed = size == 4L, endian = "little")
  header <- rawToChar(readBin(connection, "raw", length))
  type <- sub(".*'descr': *'([^']*)'.*", "\\1", header)
  fortran <- grepl("'fortran_order': *True", header)
  extents <- sub(".*'shape': *\\(([^)]*)\\).*", "\\1", header)
  dims <- as.integer(regmatches(extents, gregexpr("[0-9]+", extents))[[1]])
  shaped(read_values(connection, type, prod(dims), what), dims, fortran)
}

read_values <- function(connection, type, count, what) {
  kind <- substr(type, 2, 2)
  size <- suppressWarnings(as.integer(substring(type, 3)))
  endian <- if (substr(type, 1, 1) == ">") "big" else "little"
  values <- switch(kind,
    f = readBin(connection, "numeric", count, size = size, endian = endian),
    i = ,
    u = read_integers(connection, count, size, kind == "i", endian),
    b = readBin(connection, "integer", count, size = 1L) != 0L,
    U = read_texts(connection, count, size, endian),
    stop(what, ": values of type ", type, " are not read", call. = FALSE)
  )
  if (length(values) != count) stop(what, ": ends too early", call. = FALSE)
  values
}

# Eight bytes are read as two halves, because R's integers have four.
read_integers <- function(connection, count, size, signed, endian) {
  if (size < 8L) return(readBin(connection, "integer", count, size = size, signed = signed || size == 4L, endian = endian))
  halves <- matrix(readBin(connection, "integer", 2 * count, size = 4L, endian = endian), nrow = 2)
  if (endian == "big") halves <- halves[2:1, , drop = FALSE]
  halves[2, ] * 2^32 + ifelse(halves[1, ] < 0, halves[1, ] + 2^32, halves[1, ])
}

read_texts <- function(connection, count, length, endian) {
  points <- matrix(readBin(connection, "integer", count * length, size = 4L, endian = endian), nrow = max(length, 1L))
  vapply(seq_len(count), function(i) intToUtf8(points[points[, i] > 0, i]), "")
}

# NumPy stores the last index fastest unless it says otherwise; R the first.
shaped <- function(values, dims, fortran) {
  if (length(dims) < 2L) return(values)
  if (fortran) return(array(values, dims))
  aperm(array(values, rev(dims)))
}
