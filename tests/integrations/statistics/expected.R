# Expected values of Procrustes ANOVAs and partial least squares, in base R alone.
#
# Rscript --vanilla expected.R landmarks.csv expected.csv
#
# Superimposition, sums of squares and singular values are computed here from the definitions, independently of Python.

words <- commandArgs(trailingOnly = TRUE)
table <- read.csv(words[1], colClasses = c(individual = "character"), stringsAsFactors = FALSE)
shapes <- split(table, factor(table$shape, levels = unique(table$shape)))
points <- lapply(shapes, function(one) as.matrix(one[, c("x", "y", "z")]))
individual <- factor(vapply(shapes, function(one) one$individual[1], ""))
side <- factor(vapply(shapes, function(one) one$side[1], ""))

# Generalized Procrustes analysis: unit centroid size, rotations only.
unit <- function(m) {
  m <- sweep(m, 2, colMeans(m))
  m / sqrt(sum(m^2))
}
turned <- function(m, target) {
  s <- svd(crossprod(m, target))
  m %*% s$u %*% diag(c(1, 1, sign(det(s$u) * det(s$v)))) %*% t(s$v)
}
superimposed <- function(all) {
  all <- lapply(all, unit)
  mean <- all[[1]]
  for (round in 1:500) {
    all <- lapply(all, turned, target = mean)
    new <- Reduce(`+`, all)
    new <- new / sqrt(sum(new^2))
    moved <- sum((new - mean)^2)
    mean <- new
    if (moved < 1e-30) break
  }
  all
}
flat <- function(all) t(vapply(all, as.vector, numeric(length(all[[1]]))))

# Sequential sums of squares over all coordinates, from linear models.
left_over <- function(values, model) sum(residuals(lm(model))^2)
found <- data.frame(what = character(), value = numeric())
say <- function(what, value) found <<- rbind(found, data.frame(what = what, value = as.numeric(value)))

mirrored <- Map(function(m, s) if (s == "L") m %*% diag(c(-1, 1, 1)) else m, points, side)
paired_sides <- function(name, chosen) {
  y <- flat(superimposed(mirrored[chosen]))
  individual <- factor(individual[chosen])
  side <- factor(side[chosen])
  null <- left_over(y, y ~ 1)
  one <- left_over(y, y ~ individual)
  two <- left_over(y, y ~ individual + side)
  all <- left_over(y, y ~ individual * side)
  n <- nlevels(individual)
  error <- length(individual) - 2 * n
  ss <- c(null - one, one - two, if (error) two - all else two, if (error) all)
  ms <- ss / c(n - 1, 1, n - 1, if (error) error)
  for (at in 1:3) say(paste0(name, "-ss-", c("individual", "side", "interaction")[at]), ss[at])
  if (error) say(paste0(name, "-ss-residual"), ss[4])
  say(paste0(name, "-f-individual"), ms[1] / ms[3])
  say(paste0(name, "-f-side"), ms[2] / ms[3])
  if (error) say(paste0(name, "-f-interaction"), ms[3] / ms[4])
  for (who in levels(individual)) {
    gap <- colMeans(y[individual == who & side == "L", , drop = FALSE]) -
      colMeans(y[individual == who & side == "R", , drop = FALSE])
    say(paste0(name, "-asymmetry-", who), sqrt(sum(gap^2)))
  }
}
paired_sides("replicated", seq_along(points))
paired_sides("single", which(!duplicated(paste(individual, side))))
paired_sides("unequal", seq_along(points)[-c(1, 7)])

# Repeatability of Lessells and Boag (1987), of right sides only.
repeats <- function(name, chosen) {
  y <- flat(superimposed(points[chosen]))
  who <- factor(individual[chosen])
  null <- left_over(y, y ~ 1)
  within <- left_over(y, y ~ who)
  a <- nlevels(who)
  counts <- table(who)
  among_ms <- (null - within) / (a - 1)
  within_ms <- within / (length(who) - a)
  size <- (sum(counts) - sum(counts^2) / sum(counts)) / (a - 1)
  variance <- (among_ms - within_ms) / size
  say(paste0(name, "-repeatability"), variance / (variance + within_ms))
  say(paste0(name, "-r2"), (null - within) / null)
  say(paste0(name, "-f"), among_ms / within_ms)
}
rm(table)
repeats("repeats", which(side == "R"))
repeats("unequal-repeats", which(side == "R")[-c(1, 4)])

# Two-block partial least squares (Rohlf and Corti 2000) of coordinates that are superimposed together, and separately.
partial_least_squares <- function(name, x, y) {
  x <- scale(x, scale = FALSE)
  y <- scale(y, scale = FALSE)
  s <- svd(crossprod(x, y) / (nrow(x) - 1))
  for (at in 1:3) {
    say(paste0(name, "-singular-", at), s$d[at])
    say(paste0(name, "-r-", at), cor(x %*% s$u[, at], y %*% s$v[, at]))
  }
}
right <- points[which(side == "R")]
whole <- superimposed(right)
block <- function(all, rows) flat(lapply(all, function(m) m[rows, ]))
partial_least_squares("pls", block(whole, 1:4), block(whole, 5:9))
partial_least_squares(
  "pls-separate",
  flat(superimposed(lapply(right, function(m) m[1:4, ]))),
  flat(superimposed(lapply(right, function(m) m[5:9, ])))
)
found$value <- trimws(formatC(found$value, digits = 17, format = "g"))
write.csv(found, words[2], row.names = FALSE, quote = FALSE)
